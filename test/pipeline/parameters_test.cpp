#include "acmp_mapping/pipeline/parameters.h"

#include <set>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Refusal(const std::string& assignment) {
  PipelineOptions options;
  try {
    SetParameter(assignment, &options);
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "(accepted)";
}

TEST(ParametersTest, SetEveryKindOfOption) {
  PipelineOptions options;
  SetParameter("geometric_passes=3", &options);
  SetParameter("seed=4294967295", &options);
  SetParameter("prior_alpha=0.25", &options);
  SetParameter("use_planar_prior=false", &options);
  EXPECT_EQ(options.geometric_passes, 3);
  EXPECT_EQ(options.patch_match.seed, 4294967295u);
  EXPECT_EQ(options.patch_match.prior_alpha, 0.25f);
  EXPECT_FALSE(options.use_planar_prior);
}

TEST(ParametersTest, HaveNamesAndPlacesOfTheirOwn) {
  PipelineOptions options;
  std::set<std::string> names;
  std::set<const void*> places;
  VisitPipelineParameters(options, [&](const char* name, const auto& option) {
    EXPECT_TRUE(names.insert(name).second) << name;
    EXPECT_TRUE(places.insert(&option).second) << name;
  });
}

TEST(ParametersTest, RefuseWhatTheyCannotRead) {
  EXPECT_THAT(Refusal("geometric_passes"), HasSubstr("NAME=VALUE"));
  EXPECT_THAT(Refusal("geometric_pases=1"), AllOf(HasSubstr("geometric_pases"), HasSubstr("mean geometric_passes?")));
  EXPECT_THAT(Refusal("geometric_passes=1.5"), AllOf(HasSubstr("\"1.5\""), HasSubstr("an integer")));
  EXPECT_THAT(Refusal("prior_alpha=much"), AllOf(HasSubstr("prior_alpha"), HasSubstr("a number")));
  EXPECT_THAT(Refusal("prior_alpha=0.1 "), HasSubstr("a number"));
  EXPECT_THAT(Refusal("use_planar_prior=1"), HasSubstr("true or false"));
  EXPECT_THAT(Refusal("seed=-1"), HasSubstr("seed"));
  EXPECT_THAT(Refusal("seed="), HasSubstr("seed"));
}

}  // namespace
}  // namespace acmp
