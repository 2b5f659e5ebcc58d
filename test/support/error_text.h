#pragma once

#include <string>

#include "gmock/gmock.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

/// Message of the InvalidInputError that a call throws; "no error" when it throws none.
template <class Function>
std::string ErrorOf(Function&& function) {
  try {
    function();
  } catch (const InvalidInputError& error) {
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
