// Completion through the engines: the GPU's against the CPU's.

#include <cmath>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "fusion/engine_views.h"
#include "fusion/noisy_views.h"
#include "support/devices.h"
#include "support/pass_result.h"

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

  EstimateState Fill(const FillOptions& options = {}) {
    return engine->DownloadState(engine->FillUnverified(problem, problem.reference.estimate, options));
  }

  DepthEngine* engine;
  EngineProblem problem;
};

bool HaveEqualDepths(const EstimateState& a, const EstimateState& b, int col, int row) {
  static const PinholeCamera camera = NoisyViews()[0].camera;
  const Vec3f ray = {static_cast<float>((col - camera.cx) / camera.fx),
                     static_cast<float>((row - camera.cy) / camera.fy), 1};
  const float depth = PlaneDepth(a.planes(col, row), ray), other = PlaneDepth(b.planes(col, row), ray);
  return std::fabs(depth - other) <= 1e-4f * other;
}

class FillOnEnginesTest : public EngineTest {};
INSTANTIATE_TEST_SUITE_P(Devices, FillOnEnginesTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(FillOnEnginesTest, AgreesWithTheCpu) {
  const auto cpu = MakeDepthEngine(Device::kCpu).engine;
  FillOptions options;
  options.weighted_median = false;
  const EstimateState expected = OnEngine(cpu.get()).Fill(options);
  const EstimateState state = OnEngine(engine_.get()).Fill(options);
  int filled = 0, different = 0;
  for (int row = 0; row < expected.planes.height(); ++row) {
    for (int col = 0; col < expected.planes.width(); ++col) {
      // Which pixels no view confirms is decided in double on both.
      ASSERT_EQ(state.cost(col, row), expected.cost(col, row)) << col << ", " << row;
      if (expected.cost(col, row) < kUnverifiedCost) continue;
      ++filled;
      different += HaveEqualDepths(state, expected, col, row) ? 0 : 1;
    }
  }
  EXPECT_GT(filled, 30 * 30 * 8 / 10);
  // Up to 841 terms of a sum in another order: 841 x 6e-8 at most, half of the tolerance above, at the window's size.
  // Where two planes weigh alike another one may be the median.
  EXPECT_LE(different, filled / 100);
}

TEST_P(FillOnEnginesTest, FiltersAsTheCpuDoes) {
  const auto cpu = MakeDepthEngine(Device::kCpu).engine;
  FillOptions without;
  without.weighted_median = false;
  const EstimateState unfiltered = OnEngine(cpu.get()).Fill(without);
  const EstimateState expected = OnEngine(cpu.get()).Fill();
  const EstimateState state = OnEngine(engine_.get()).Fill();
  int filtered = 0, different = 0, turned = 0;
  for (int row = 0; row < expected.planes.height(); ++row) {
    for (int col = 0; col < expected.planes.width(); ++col) {
      filtered += expected.planes(col, row).d != unfiltered.planes(col, row).d ? 1 : 0;
      const bool same = HaveEqualDepths(state, expected, col, row) && state.cost(col, row) == expected.cost(col, row);
      different += same ? 0 : 1;
      const float cosine = Dot(state.planes(col, row).normal(), expected.planes(col, row).normal());
      turned += cosine > 0.9998f ? 0 : 1;  // a degree
    }
  }
  EXPECT_GT(filtered, 100);
  // Depths, not planes: of two samples with nearly the same depth either may be the median, with a normal of its own.
  // Rounding of weights and depths, and the completion's of planes (see above). Where the weight up to two samples is
  // half of all but for rounding, the other one may be the median, which may be on the other side of the limit on a
  // cost that stays.
  EXPECT_LE(different, static_cast<int>(expected.planes.size()) / 100);
  // Whoever took the depth of one sample and the normal of another would turn nearly all of the filtered ones: the
  // scene's normals are noise. Of equal depths either may win.
  EXPECT_LE(turned, filtered / 4);
}

TEST_P(FillOnEnginesTest, GivesTheSameBitsAgainAndLeavesAStartThatIsHeldAsItWas) {
  OnEngine scene(engine_.get());
  const EstimateState before = engine_->DownloadState(scene.problem.reference.estimate);
  const EstimateState first = scene.Fill();
  EXPECT_TRUE(SameBits(scene.Fill(), first));
  EXPECT_TRUE(SameBits(engine_->DownloadState(scene.problem.reference.estimate), before));
  EXPECT_FALSE(SameBits(first, before));
  EngineEstimatePtr start = std::move(scene.problem.reference.estimate);  // now nobody else holds it
  EXPECT_TRUE(SameBits(engine_->DownloadState(engine_->FillUnverified(scene.problem, std::move(start), {})), first));
}

TEST_P(FillOnEnginesTest, SourcesWithoutAnEstimateDoNotCount) {
  OnEngine scene(engine_.get());
  const EstimateState before = engine_->DownloadState(scene.problem.reference.estimate);
  for (EngineView& source : scene.problem.sources) source.estimate = nullptr;
  EXPECT_TRUE(SameBits(scene.Fill(), before));
}

TEST_P(FillOnEnginesTest, BadInputIsRefused) {
  OnEngine scene(engine_.get());
  scene.problem.depth_range = {2, 1};
  EXPECT_THROW(scene.Fill(), InvalidInputError);
  scene.problem.depth_range = {1, 20};
  const FramePtr frame = scene.problem.reference.frame;
  scene.problem.reference.frame = nullptr;
  EXPECT_THROW(scene.Fill(), InvalidInputError);
  scene.problem.reference.frame = frame;
  scene.problem.reference.estimate = nullptr;
  EXPECT_THROW(scene.Fill(), InvalidInputError);
}

}  // namespace
}  // namespace acmp
