#include "acmp_mapping/common/error.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(ErrorTest, RangeIncludesItsEndsAndNothingThatIsNotFinite) {
  constexpr float kInf = std::numeric_limits<float>::infinity(), kNan = std::numeric_limits<float>::quiet_NaN();
  for (const float legal : {-1.0f, 0.5f, 1.0f}) EXPECT_NO_THROW(CheckRange("x", legal, -1.0f, 1.0f));
  for (const float illegal : {std::nextafter(1.0f, 2.0f), -1.5f, kNan, kInf, -kInf}) {
    EXPECT_THROW(CheckRange("x", illegal, -1.0f, 1.0f), InvalidInputError) << illegal;
  }
  EXPECT_THAT(ErrorOf([] { CheckRange("fusion.views", 7, 1, 5); }),
              AllOf(HasSubstr("fusion.views = 7"), HasSubstr("[1, 5]")));
}

}  // namespace
}  // namespace acmp
