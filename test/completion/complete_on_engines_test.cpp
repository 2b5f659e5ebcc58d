// Completion through the engines: the GPU's against the CPU's.

#include <cmath>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "fusion/engine_views.h"
#include "fusion/noisy_views.h"
#include "support/devices.h"

namespace acmp {
namespace {

/// The noisy views as an engine sees them, a third of the reference's pixels without support in the others.
struct OnEngine {
  explicit OnEngine(DepthEngine* depth_engine) : engine(depth_engine) {
    std::vector<TestView> views = NoisyViews();
    for (int row = 10; row < 40; ++row) {
      for (int col = 20; col < 50; ++col) views[0].depth(col, row) *= 1.5f;
    }
    problem.sources = UploadViews(views, engine);
    problem.reference = problem.sources.front();
    problem.sources.erase(problem.sources.begin());
    problem.depth_range = {1, 20};
  }

  EstimateState Complete(const CompletionOptions& options = {}) {
    return engine->DownloadState(engine->Complete(problem, options));
  }

  DepthEngine* engine;
  EngineProblem problem;
};

class CompleteOnEnginesTest : public EngineTest {};
INSTANTIATE_TEST_SUITE_P(Devices, CompleteOnEnginesTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(CompleteOnEnginesTest, AgreesWithTheCpu) {
  const auto cpu = MakeDepthEngine(Device::kCpu).engine;
  CompletionOptions options;
  options.weighted_median = false;
  const EstimateState expected = OnEngine(cpu.get()).Complete(options);
  const EstimateState state = OnEngine(engine_.get()).Complete(options);
  int completed = 0, different = 0;
  const PinholeCamera camera = NoisyViews()[0].camera;
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      // Which pixels no view confirms is decided in double on both.
      ASSERT_EQ(state.cost(col, row), expected.cost(col, row)) << col << ", " << row;
      if (expected.cost(col, row) < kUnverifiedCost) continue;
      ++completed;
      const Vec3f ray = {static_cast<float>((col - camera.cx) / camera.fx),
                         static_cast<float>((row - camera.cy) / camera.fy), 1};
      const float depth = PlaneDepth(state.planes(col, row), ray);
      const float expected_depth = PlaneDepth(expected.planes(col, row), ray);
      different += std::fabs(depth - expected_depth) <= 1e-4f * expected_depth ? 0 : 1;
    }
  }
  EXPECT_GT(completed, 30 * 30 * 8 / 10);
  // Up to 841 terms of a sum in another order: 841 x 6e-8 at most, half of the tolerance above, at the window's size.
  // Where two planes weigh alike another one may be the median.
  EXPECT_LE(different, completed / 100);
}

TEST_P(CompleteOnEnginesTest, FiltersAsTheCpuDoes) {
  const auto cpu = MakeDepthEngine(Device::kCpu).engine;
  CompletionOptions without;
  without.weighted_median = false;
  const EstimateState unfiltered = OnEngine(cpu.get()).Complete(without);
  const EstimateState expected = OnEngine(cpu.get()).Complete();
  const EstimateState state = OnEngine(engine_.get()).Complete();
  int filtered = 0, different = 0;
  for (size_t i = 0; i < state.planes.size(); ++i) {
    const PlaneHypothesis& plane = state.planes.data()[i];
    const PlaneHypothesis& expected_plane = expected.planes.data()[i];
    filtered += expected_plane.d != unfiltered.planes.data()[i].d ? 1 : 0;
    const bool same = std::fabs(plane.d - expected_plane.d) <= 1e-4f * expected_plane.d &&
                      state.cost.data()[i] == expected.cost.data()[i];
    different += same ? 0 : 1;
  }
  EXPECT_GT(filtered, 100);
  // Rounding of weights and depths, and the completion's of planes (see above). Where two samples weigh alike another
  // one may be the median, which may be on the other side of the limit on a cost that stays.
  EXPECT_LE(different, static_cast<int>(state.planes.size()) / 100);
}

TEST_P(CompleteOnEnginesTest, GivesTheSameBitsAgainAndLeavesTheStartAsItWas) {
  OnEngine scene(engine_.get());
  const EstimateState before = engine_->DownloadState(scene.problem.reference.estimate);
  const EstimateState first = scene.Complete(), second = scene.Complete();
  const EstimateState after = engine_->DownloadState(scene.problem.reference.estimate);
  for (size_t i = 0; i < first.planes.size(); ++i) {
    ASSERT_EQ(first.planes.data()[i].d, second.planes.data()[i].d);
    ASSERT_EQ(before.planes.data()[i].d, after.planes.data()[i].d);
    ASSERT_EQ(before.cost.data()[i], after.cost.data()[i]);
  }
}

TEST_P(CompleteOnEnginesTest, SourcesWithoutAnEstimateDoNotCount) {
  OnEngine scene(engine_.get());
  const EstimateState before = engine_->DownloadState(scene.problem.reference.estimate);
  for (EngineView& source : scene.problem.sources) source.estimate = nullptr;
  const EstimateState after = scene.Complete();
  for (size_t i = 0; i < before.planes.size(); ++i) ASSERT_EQ(before.planes.data()[i].d, after.planes.data()[i].d);
}

TEST_P(CompleteOnEnginesTest, BadInputIsRefused) {
  OnEngine scene(engine_.get());
  CompletionOptions options;
  options.anchor_views = 0;
  EXPECT_THROW(scene.Complete(options), InvalidInputError);
  scene.problem.depth_range = {2, 1};
  EXPECT_THROW(scene.Complete(), InvalidInputError);
  scene.problem.depth_range = {1, 20};
  const FramePtr frame = scene.problem.reference.frame;
  scene.problem.reference.frame = nullptr;
  EXPECT_THROW(scene.Complete(), InvalidInputError);
  scene.problem.reference.frame = frame;
  scene.problem.reference.estimate = nullptr;
  EXPECT_THROW(scene.Complete(), InvalidInputError);
}

}  // namespace
}  // namespace acmp
