#include "acmp_mapping/pipeline/presets.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/depth_engine.h"

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

TEST(PresetsTest, OnlineTakesAllStepsWithLessWork) {
  const PipelineOptions online = MakePreset("online");
  EXPECT_EQ(online.start_level, 1);
  EXPECT_EQ(online.patch_match.photometric_iterations, 3);
  EXPECT_EQ(online.full_size_iterations, 1);
  EXPECT_TRUE(online.use_planar_prior);
  EXPECT_EQ(online.planar_prior.cell_size_px, 10);
  EXPECT_EQ(online.patch_match.planar_prior_iterations, 1);
  EXPECT_EQ(online.geometric_passes, 1);
  EXPECT_EQ(online.patch_match.geometric_iterations, 1);
  EXPECT_EQ(online.patch_match.min_neighbours_per_view, 1);
  EXPECT_EQ(online.patch_match.view_draws, 8);
  EXPECT_EQ(online.fusion.min_confidence, 0.35f);
  EXPECT_EQ(online.fusion.min_consistent_views, 0);
  EXPECT_EQ(online.fusion.max_relative_depth, 0.02f);

  EXPECT_EQ(online.patch_match.method, Method::kOurs);
}

TEST(PresetsTest, UnknownNameIsAnErrorThatListsAllNames) {
  for (const char* name : {"", "ACMP", "acmp ", "colmap", "onlin", "Online"}) {
    try {
      MakePreset(name);
      ADD_FAILURE() << "accepted \"" << name << '"';
    } catch (const InvalidInputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(Concat("\"", name, "\"")));
      EXPECT_THAT(error.what(), HasSubstr("must be one of acmh, acmm"));
      for (const std::string& known : PresetNames()) EXPECT_THAT(error.what(), HasSubstr(known));
    }
  }
}

std::string Message(const PipelineOptions& options) {
  try {
    Validate(options);
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "";
}

TEST(PipelineOptionsTest, PartsAreChecked) {
  PipelineOptions matching, prior, fusion;
  matching.patch_match.view_draws = 0;
  prior.planar_prior.cell_size_px = 0;
  fusion.fusion.max_reprojection_px = -1;
  EXPECT_THAT(Message(matching), HasSubstr("view_draws = 0"));
  EXPECT_THAT(Message(prior), HasSubstr("cell_size_px = 0"));
  EXPECT_THAT(Message(fusion), HasSubstr("max_reprojection_px = -1"));
}

}  // namespace
}  // namespace acmp
