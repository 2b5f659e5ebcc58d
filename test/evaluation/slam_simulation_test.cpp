#include "acmp_mapping/synthetic/synthetic_scene.h"

#include "gtest/gtest.h"

#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {
namespace {

std::vector<SyntheticView> Views(int count) { return MakeSyntheticScene({48, 36, count}); }

Eigen::Vector3d Centre(const SlamOutput& output) { return output.cam_from_world.inverse().translation(); }

/// Without errors that are random.
SlamErrors DriftAlone() {
  SlamErrors errors;
  errors.jitter_deg = errors.jitter_m = 0;
  return errors;
}

TEST(SimulateSlamTest, LandmarksProjectWhereTheyDoInTruth) {
  const std::vector<SyntheticView> views = Views(9);
  const SlamRun run = SimulateSlam(views, DriftAlone(), 1);
  for (size_t i = 3; i < 9; ++i) {
    const Frame& frame = views[i].frame;
    const std::vector<Eigen::Vector3d>& landmarks = run.outputs[i].landmarks_in_world;
    ASSERT_EQ(landmarks.size(), frame.landmarks_in_world.size());
    ASSERT_FALSE(landmarks.empty());
    const double scale =
        i < run.loop_closure ? 0.5 * (1 + 0.06 * static_cast<double>(i - 3) / 4.0) : 0.5;  // closes at 7
    for (size_t k = 0; k < landmarks.size(); ++k) {
      const Eigen::Vector3d expected = frame.cam_from_world * frame.landmarks_in_world[k];
      // Rounding of double at a few metres.
      EXPECT_LT((run.outputs[i].cam_from_world * landmarks[k] - scale * expected).norm(), 1e-12) << i;
    }
  }
}

TEST(SimulateSlamTest, StartsLateAndDriftsUntilTheLoopIsClosed) {
  const std::vector<SyntheticView> views = Views(12);
  const SlamRun run = SimulateSlam(views, DriftAlone(), 1);
  ASSERT_EQ(run.loop_closure, 9u);
  ASSERT_EQ(run.corrected.size(), 9u);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_TRUE(run.outputs[i].cam_from_world.matrix().isIdentity() && run.outputs[i].landmarks_in_world.empty()) << i;
  }
  const auto error_m = [&](size_t i) {
    return (run.ToTrueWorld(Centre(run.outputs[i])) - views[i].frame.cam_from_world.inverse().translation()).norm();
  };
  EXPECT_LT(error_m(3), 1e-12);
  for (size_t i = 4; i < run.loop_closure; ++i) EXPECT_GT(error_m(i), 0.001) << i;
  for (size_t i = run.loop_closure; i < 12; ++i) EXPECT_LT(error_m(i), 1e-12) << i;
  for (size_t i = 3; i < run.loop_closure; ++i) {
    const Eigen::Vector3d corrected = run.ToTrueWorld(run.corrected[i].translation());
    EXPECT_LT((corrected - views[i].frame.cam_from_world.inverse().translation()).norm(), 1e-12) << i;
  }
}

}  // namespace
}  // namespace acmp
