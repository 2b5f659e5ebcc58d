#include "acmp_mapping/mapping/rig_unit_check.h"

#include <cmath>
#include <cstdlib>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

/// What is said of a pair whose declared baseline is `factor` times the right one; "" if nothing is.
std::string WarningOf(const std::vector<SyntheticView>& views, double factor) {
  RigUnitCheck check;
  std::string warning;
  for (const SyntheticView& view : views) {
    Frame right;
    right.camera = view.right->camera;
    right.gray = view.right->gray.Clone();
    RigidTransform right_from_left = view.right->cam_from_world * view.frame.cam_from_world.inverse();
    right_from_left.translation() *= factor;
    right.cam_from_world = right_from_left * view.frame.cam_from_world;
    if (const auto text = check.Add(view.frame, right)) {
      EXPECT_EQ(warning, "") << "it is said once";
      warning = *text;
    }
  }
  return warning;
}

TEST(RigUnitCheck, ABaselineInAnotherUnitIsNamedWithItsFactor) {
  SyntheticSceneOptions options;
  options.width = 320;
  options.height = 240;
  options.keyframes = 8;
  options.stereo_baseline_m = 0.11;
  const std::vector<SyntheticView> views = MakeSyntheticScene(options);
  EXPECT_EQ(WarningOf(views, 1), "");
  EXPECT_EQ(WarningOf(views, 1.08), "") << "as calibrations are off";
  for (const double factor : {0.3, 4.0}) {
    const std::string warning = WarningOf(views, factor);
    ASSERT_THAT(warning, HasSubstr(" times as far away")) << factor;
    const double found = std::strtod(warning.substr(warning.find("if it were ") + 11).c_str(), nullptr);
    EXPECT_NEAR(found * factor, 1, 0.15) << warning;
    EXPECT_THAT(warning, HasSubstr("monocular"));
  }
}

}  // namespace
}  // namespace acmp
