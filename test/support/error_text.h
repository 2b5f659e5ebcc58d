#pragma once

#include <string>

#include "gmock/gmock.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

// The matchers of texts and lists that tests use.
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;
using ::testing::UnorderedElementsAre;

/// Message of the error of type E that a call throws; "no error" when it throws none.
template <class E = InvalidInputError, class Function>
std::string ErrorOf(const Function& function) {
  try {
    function();
  } catch (const E& error) {
    return error.what();
  }
  return "no error";
}

/// Matches a text that has all of these.
template <class... Texts>
auto HasAll(const Texts&... texts) {
  return ::testing::AllOf(::testing::HasSubstr(texts)...);
}

}  // namespace acmp

/// The statement throws an InvalidInputError whose message has all of these texts.
#define EXPECT_REFUSED(statement, ...) EXPECT_THAT(::acmp::ErrorOf([&] { statement; }), ::acmp::HasAll(__VA_ARGS__))
