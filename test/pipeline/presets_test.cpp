#include <map>
#include <string>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/presets.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

TEST(PresetsTest, AreThePapersSystemsAndOurs) {
  EXPECT_THAT(PresetNames(), ::testing::ElementsAre("acmh", "acmm", "acmp_no_geometric", "acmp", "balanced", "online"));
  for (const std::string& name : PresetNames()) EXPECT_NO_THROW(Validate(MakePreset(name))) << name;
}

TEST(PresetsTest, ThePapersRunTheStepsOfTheirPapersAndNothingElse) {
  const PipelineOptions acmh = MakePreset("acmh");
  EXPECT_EQ(acmh.patch_match.method, Method::kAcmh);
  EXPECT_FALSE(acmh.use_planar_prior);
  EXPECT_EQ(acmh.geometric_passes, 0);
  const PipelineOptions acmm = MakePreset("acmm");
  EXPECT_EQ(acmm.geometric_passes, 2);
  EXPECT_EQ(acmm.patch_match.geometric_weight, 0.2f);
  EXPECT_EQ(acmm.patch_match.geometric_max_px, 3.0f);
  const PipelineOptions no_geometric = MakePreset("acmp_no_geometric");
  EXPECT_TRUE(no_geometric.use_planar_prior);
  EXPECT_EQ(no_geometric.geometric_passes, 0);
  const PipelineOptions acmp = MakePreset("acmp");
  EXPECT_TRUE(acmp.use_planar_prior);
  EXPECT_EQ(acmp.geometric_passes, 2);
  for (const PipelineOptions& later : {no_geometric, acmp}) {
    // Section "Experiments", parameter settings; section "The Algorithm".
    const PatchMatchOptions& match = later.patch_match;
    EXPECT_EQ(match.method, Method::kAcmp);
    EXPECT_EQ(later.planar_prior.max_support_cost, 0.1f);
    EXPECT_EQ(match.prior_alpha, 0.18f);
    EXPECT_EQ(match.prior_gamma, 0.5f);
    EXPECT_EQ(match.prior_sigma_normal_deg, 5.0f);
    EXPECT_EQ(match.prior_depth_divisor, 64.0f);
    EXPECT_EQ(match.sigma_view, 0.3f);
    EXPECT_EQ(match.view_smoothness, 0.9f);
    EXPECT_EQ(match.geometric_weight, 0.1f);
    EXPECT_EQ(match.geometric_max_px, 5.0f);
    EXPECT_EQ(match.photometric_iterations, 3);
    EXPECT_EQ(match.planar_prior_iterations, 3);
    EXPECT_EQ(match.geometric_iterations, 2);
    EXPECT_EQ(later.planar_prior.cell_size_px, 5);
  }
  for (const PipelineOptions& paper : {acmh, no_geometric, acmp}) {
    EXPECT_EQ(paper.start_level, 0);
    EXPECT_EQ(paper.full_size_iterations, 0);
    EXPECT_FALSE(paper.fill.enabled);
    EXPECT_EQ(paper.fusion.max_reprojection_px, 2.0f);
    EXPECT_EQ(paper.fusion.max_relative_depth, 0.01f);
    EXPECT_EQ(paper.fusion.max_normal_angle_deg, 10.0f);
    EXPECT_EQ(paper.fusion.min_consistent_views, 2);
    EXPECT_EQ(paper.fusion.min_confidence, 0);
  }
}

TEST(PresetsTest, UnknownNameIsAnErrorThatListsAllNames) {
  for (const char* name : {"", "ACMP", "acmp ", "Online"}) {
    const std::string error = ErrorOf([&] { MakePreset(name); });
    EXPECT_THAT(error, HasSubstr(Concat("\"", name, "\"")));
    for (const std::string& known : PresetNames()) EXPECT_THAT(error, HasSubstr(known));
  }
}

/// A bound of the option, or the other value of a flag.
OptionValue Extreme(const Option& option, bool upper) {
  const double bound = upper ? option.max : option.min;
  if (std::holds_alternative<bool>(option.get())) return upper;
  if (std::holds_alternative<int>(option.get())) return static_cast<int>(bound);
  return bound;
}

TEST(ParametersTest, SettingOneChangesThatOneAlone) {
  PipelineOptions options, defaults;
  const OptionList of_defaults = OptionsOf(&defaults);
  for (const Option& changed : OptionsOf(&options)) {
    options = {};
    const bool at_top = changed.get() == Extreme(changed, true);
    changed.set(Extreme(changed, !at_top));
    for (const Option& option : OptionsOf(&options)) {
      EXPECT_EQ(option.get() == of_defaults.Find(option.name).get(), option.name != changed.name)
          << changed.name << ", " << option.name;
    }
  }
}

std::string StepsOf(const PipelineOptions& options) {
  using Kind = KeyframeStep::Kind;
  const std::map<Kind, std::string> names = {{Kind::kInitial, "initial"},
                                             {Kind::kNextScale, "next scale"},
                                             {Kind::kFillForPasses, "fill for passes"},
                                             {Kind::kGeometricPass, "pass"},
                                             {Kind::kFillUnverified, "fill"}};
  std::string steps;
  for (const KeyframeStep& step : ScheduleOf(options)) {
    steps += (steps.empty() ? "" : ", ") + names.at(step.kind);
    if (step.kind == Kind::kGeometricPass) steps += Concat(" ", step.pass);
    if (step.level > 0) steps += Concat(" at level ", step.level);
  }
  return steps;
}

std::string StepsOf(bool fills, int geometric_passes) {
  PipelineOptions options;
  options.fill.enabled = fills;
  options.geometric_passes = geometric_passes;
  return StepsOf(options);
}

TEST(ScheduleTest, PassesFollowTheInitialEstimateAndWhatIsUnverifiedIsFilledBeforeAndAfterThem) {
  EXPECT_EQ(StepsOf(false, 0), "initial");
  EXPECT_EQ(StepsOf(false, 2), "initial, pass 0, pass 1");
  EXPECT_EQ(StepsOf(true, 0), "initial, fill") << "nothing checks what would be offered to passes";
  EXPECT_EQ(StepsOf(true, 2), "initial, fill for passes, pass 0, pass 1, fill");
}

TEST(ScheduleTest, AcmmTakesAllStepsAtEachScale) {
  EXPECT_EQ(StepsOf(MakePreset("acmm")),
            "initial at level 2, pass 0 at level 2, pass 1 at level 2, "
            "next scale at level 1, pass 0 at level 1, pass 1 at level 1, next scale, pass 0, pass 1");
}

}  // namespace
}  // namespace acmp
