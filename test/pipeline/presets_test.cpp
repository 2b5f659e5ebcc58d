#include "acmp_mapping/pipeline/presets.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/depth_engine.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(PresetsTest, AreTheSystemsOfThePaper) {
  EXPECT_THAT(PresetNames(), ::testing::ElementsAre("acmh", "acmp_no_geometric", "acmp"));
  for (const std::string& name : PresetNames()) EXPECT_NO_THROW(Validate(MakePreset(name))) << name;

  const PipelineOptions acmh = MakePreset("acmh");
  EXPECT_FALSE(acmh.use_planar_prior);
  EXPECT_EQ(acmh.geometric_passes, 2);
  const PipelineOptions no_geometric = MakePreset("acmp_no_geometric");
  EXPECT_TRUE(no_geometric.use_planar_prior);
  EXPECT_EQ(no_geometric.geometric_passes, 0);
  const PipelineOptions acmp = MakePreset("acmp");
  EXPECT_TRUE(acmp.use_planar_prior);
  EXPECT_EQ(acmp.geometric_passes, 2);
}

TEST(PresetsTest, DefaultOptionsAreAcmp) {
  const PipelineOptions options, acmp = MakePreset("acmp");
  EXPECT_EQ(options.use_planar_prior, acmp.use_planar_prior);
  EXPECT_EQ(options.geometric_passes, acmp.geometric_passes);
}

TEST(PresetsTest, UnknownNameIsAnErrorThatListsAllNames) {
  for (const char* name : {"", "ACMP", "acmp ", "colmap"}) {
    try {
      MakePreset(name);
      ADD_FAILURE() << "accepted \"" << name << '"';
    } catch (const InvalidInputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(Concat("\"", name, "\"")));
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

TEST(PipelineOptionsTest, GeometricPassesAreBounded) {
  PipelineOptions options;
  for (const int good : {0, 10}) {
    options.geometric_passes = good;
    EXPECT_EQ(Message(options), "");
  }
  for (const int bad : {-1, 11}) {
    options.geometric_passes = bad;
    EXPECT_THAT(Message(options), AllOf(HasSubstr(Concat("geometric_passes = ", bad)), HasSubstr("[0, 10]")));
  }
}

TEST(PipelineOptionsTest, StartLevelIsBounded) {
  PipelineOptions options;
  for (const int good : {0, kMaxLevels}) {
    options.start_level = good;
    EXPECT_EQ(Message(options), "");
  }
  for (const int bad : {-1, kMaxLevels + 1}) {
    options.start_level = bad;
    EXPECT_THAT(Message(options), AllOf(HasSubstr(Concat("start_level = ", bad)), HasSubstr("[0, 2]")));
  }
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
