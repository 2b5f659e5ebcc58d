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

TEST(PipelineOptionsTest, PartsAreChecked) {
  PipelineOptions matching, prior, fusion;
  matching.patch_match.view_draws = 0;
  prior.planar_prior.cell_size_px = 0;
  fusion.fusion.max_reprojection_px = -1;
  EXPECT_THAT(ErrorOf([&] { Validate(matching); }), HasSubstr("view_draws = 0"));
  EXPECT_THAT(ErrorOf([&] { Validate(prior); }), HasSubstr("cell_size_px = 0"));
  EXPECT_THAT(ErrorOf([&] { Validate(fusion); }), HasSubstr("max_reprojection_px = -1"));
}

}  // namespace
}  // namespace acmp
