// The free-space check through the engines: a blank sky over a textured house front, in which all views see a nearer
// wall.

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/fill/fill_options.h"
#include "support/devices.h"
#include "support/random_views.h"

namespace acmp {
namespace {

constexpr int kFineWidth = 160, kFineHeight = 120, kViews = 5;  // cells of 1 px

class FreeSpaceCheckOnEnginesTest : public EngineTest {
 protected:
  /// Six rows of the house beside the sky have windows that see both.
  static constexpr int kRoof = 60, kRim = 6;

  void SetUp() override {
    EngineTest::SetUp();
    if (!IsSkipped()) scene_ = MakeScene(engine_.get());
  }

  static EngineProblem MakeScene(DepthEngine* engine) {
    const WorldPlane front = WorldPlane::Slanted(0, 0, 6), near = WorldPlane::Slanted(0, 0, 3);
    std::vector<PlanarView> views = RenderPlanarScene(front, kFineWidth, kFineHeight, kViews);
    TestRandom random(3);
    EngineProblem problem;
    for (PlanarView& view : views) {
      const PlanarView wall = RenderPlane(near, WaveTexture(1, 0.05, 1), view.camera, view.cam_from_world);
      const Eigen::Vector3d normal = view.cam_from_world.linear() * front.normal;
      NormalMap normals(
          kFineWidth, kFineHeight,
          Vec3f{static_cast<float>(normal.x()), static_cast<float>(normal.y()), static_cast<float>(normal.z())});
      for (int row = 0; row < kRoof; ++row) {
        for (int col = 0; col < kFineWidth; ++col) {
          view.depth(col, row) = wall.depth(col, row);
          view.gray(col, row) = static_cast<float>(150 + random(-1, 1));
        }
      }
      auto frame = std::make_shared<Frame>();
      frame->id = static_cast<int64_t>(problem.sources.size());
      frame->camera = view.camera;
      frame->cam_from_world = view.cam_from_world;
      frame->gray = view.gray.Clone();
      const CostMap cost(kFineWidth, kFineHeight, 0.3f);
      problem.sources.push_back({frame, engine->Load(frame, 0),
                                 engine->UploadMaps({view.depth.View(), normals.View(), cost.View()}, view.camera)});
    }
    problem.reference = problem.sources.front();
    problem.sources.erase(problem.sources.begin());
    problem.depth_range = {1, 20};
    return problem;
  }

  /// Of a start that the scene holds, too.
  EngineEstimatePtr RemoveUnsupported() { return engine_->RemoveUnsupported(scene_, scene_.reference.estimate); }

  EngineProblem scene_;
};
INSTANTIATE_TEST_SUITE_P(Devices, FreeSpaceCheckOnEnginesTest, ::testing::Values(Device::kCpu, Device::kCuda),
                         DeviceName);

TEST_P(FreeSpaceCheckOnEnginesTest, RemovesTheWallInTheSkyAndNothingElse) {
  const EstimateState state = engine_->DownloadState(RemoveUnsupported());
  int unsupported = 0, kept = 0;
  for (int row = 0; row < kFineHeight; ++row) {
    for (int col = 0; col < kFineWidth; ++col) {
      const bool is_unsupported = state.cost(col, row) == kUnsupportedCost;
      ASSERT_TRUE(is_unsupported || state.cost(col, row) == 0.3f);
      if (row < kRoof - kRim) unsupported += is_unsupported ? 1 : 0;
      // Where at least two views see all of a window.
      if (row > kRoof + kRim && row < kFineHeight - 12 && col > 30 && col < kFineWidth - 30)
        kept += is_unsupported ? 0 : 1;
    }
  }
  // Of what is blank a hundredth may look textured (depth_evidence_test.cpp).
  EXPECT_GT(unsupported, 0.98 * kFineWidth * (kRoof - kRim));
  EXPECT_EQ(kept, (kFineHeight - 13 - kRoof - kRim) * (kFineWidth - 61));
}

TEST_P(FreeSpaceCheckOnEnginesTest, KeepsPlanesAndLeavesTheStartAsItWas) {
  const EstimateState before = engine_->DownloadState(scene_.reference.estimate);
  const EstimateState unsupported = engine_->DownloadState(RemoveUnsupported());
  const EstimateState after = engine_->DownloadState(scene_.reference.estimate);
  for (size_t i = 0; i < before.planes.size(); ++i) {
    ASSERT_EQ(unsupported.planes.data()[i].d, before.planes.data()[i].d);
    ASSERT_EQ(after.cost.data()[i], before.cost.data()[i]);
  }
}

TEST_P(FreeSpaceCheckOnEnginesTest, UsesUpAStartThatNobodyElseHolds) {
  const EstimateMaps before = engine_->Download(scene_.reference.estimate);
  const EstimateState expected = engine_->DownloadState(RemoveUnsupported());
  const EngineEstimate* start = scene_.reference.estimate.get();
  const EngineEstimatePtr unsupported = engine_->RemoveUnsupported(scene_, std::move(scene_.reference.estimate));
  if (GetParam() == Device::kCuda) {
    EXPECT_EQ(unsupported.get(), start);
  }
  const EstimateState state = engine_->DownloadState(unsupported);
  EXPECT_TRUE(std::equal(state.cost.begin(), state.cost.end(), expected.cost.begin(), expected.cost.end()));
  const DepthMap depth = engine_->Download(unsupported).depth;
  EXPECT_TRUE(std::equal(depth.begin(), depth.end(), before.depth.begin(), before.depth.end()));
}

TEST_P(FreeSpaceCheckOnEnginesTest, AgreesWithTheCpu) {
  const auto cpu = MakeDepthEngine(Device::kCpu).engine;
  const EngineProblem scene = MakeScene(cpu.get());
  const EstimateState expected = cpu->DownloadState(cpu->RemoveUnsupported(scene, scene.reference.estimate));
  const EstimateState state = engine_->DownloadState(RemoveUnsupported());
  int different = 0;
  for (size_t i = 0; i < expected.cost.size(); ++i) {
    different += state.cost.data()[i] != expected.cost.data()[i] ? 1 : 0;
  }
  // Evidence that lies at the limit: of windows at the rim.
  EXPECT_LE(different, kFineWidth * kFineHeight / 100);
}

TEST_P(FreeSpaceCheckOnEnginesTest, BadInputIsRefused) {
  scene_.reference.estimate = nullptr;
  EXPECT_THROW(RemoveUnsupported(), InvalidInputError);
  scene_.reference.frame = nullptr;
  EXPECT_THROW(RemoveUnsupported(), InvalidInputError);
}

}  // namespace
}  // namespace acmp
