#include "acmp_mapping/common/error.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

TEST(ErrorTest, RangeIncludesItsEnds) {
  EXPECT_NO_THROW(CheckRange("x", 1, 1, 3));
  EXPECT_NO_THROW(CheckRange("x", 3, 1, 3));
  EXPECT_THROW(CheckRange("x", 0, 1, 3), InvalidInputError);
  EXPECT_THROW(CheckRange("x", 4, 1, 3), InvalidInputError);
  EXPECT_NO_THROW(CheckRange("x", 0.5f, 0.5f, 0.5f));
  EXPECT_THROW(CheckRange("x", std::nextafter(0.5f, 1.0f), 0.5f, 0.5f), InvalidInputError);
}

TEST(ErrorTest, RangeRefusesWhatIsNotFinite) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  EXPECT_THROW(CheckRange("x", std::numeric_limits<float>::quiet_NaN(), -1.0f, 1.0f), InvalidInputError);
  EXPECT_THROW(CheckRange("x", kInf, -1.0f, 1.0f), InvalidInputError);
  EXPECT_THROW(CheckRange("x", -kInf, -1.0f, 1.0f), InvalidInputError);
}

TEST(ErrorTest, MessageHasNameValueAndBounds) {
  try {
    CheckRange("fusion.views", 7, 1, 5);
    FAIL() << "no exception";
  } catch (const InvalidInputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("fusion.views = 7"));
    EXPECT_THAT(error.what(), HasSubstr("[1, 5]"));
  }
}

}  // namespace
}  // namespace acmp
