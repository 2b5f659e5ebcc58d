#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/fill/fill.h"
#include "support/devices.h"
#include "support/engine_scene.h"
#include "support/pass_result.h"
#include "support/random_views.h"

namespace acmp {
namespace {

constexpr int kWidth = 320, kHeight = 240;  // cells of 2 px
constexpr int kRoof = 120;                  // row

/// A sky over a house front at a depth of 20. All of the sky has a nearer wall's plane, as have some pixels of the
/// house that nothing speaks for. The house is textured.
class FreeSpaceCheckTest : public ::testing::Test {
 protected:
  FreeSpaceCheckTest()
      : evidence_(CellsOf(kWidth, kCell), CellsOf(kHeight, kCell)),
        planes_(kWidth, kHeight, At(20)),
        cost_(kWidth, kHeight, 0.3f) {
    for (int row = 0; row < evidence_.height(); ++row) {
      for (int col = 0; col < evidence_.width(); ++col) evidence_(col, row) = row * kCell < kRoof ? 0.0f : 50.0f;
    }
    SetSky(At(10));
  }

  static PlaneHypothesis At(float depth) { return {0, 0, -1, depth}; }
  void SetSky(const PlaneHypothesis& plane) {
    for (int row = 0; row < kRoof; ++row) {
      for (int col = 0; col < kWidth; ++col) planes_(col, row) = plane;
    }
  }
  void Check() { RemoveUnsupported(camera_, evidence_.View(), planes_.View(), cost_.View()); }
  int CountUnsupported(int first_row, int end_row) const {
    int count = 0;
    for (int row = first_row; row < end_row; ++row) {
      for (int col = 0; col < kWidth; ++col) count += cost_(col, row) == kUnsupportedCost ? 1 : 0;
    }
    return count;
  }

  static constexpr int kCell = 2;
  const PinholeCamera camera_ = {kWidth, kHeight, 300, 300, 159.5, 119.5};
  Image<float> evidence_;
  PlaneMap planes_;
  CostMap cost_;
};

TEST_F(FreeSpaceCheckTest, ASurfaceHidesWhatIsATenthFartherAway) {
  for (const auto& [depth, rows] : {std::pair(18.5f, 0), {17.8f, kRoof}}) {  // 20 / 1.1 = 18.2
    for (float& cost : cost_) cost = 0.3f;
    SetSky(At(depth));
    Check();
    EXPECT_EQ(CountUnsupported(0, kHeight), rows * kWidth) << depth;
  }
}

TEST_F(FreeSpaceCheckTest, OnlyTheNearestTexturedPixelOfADirectionCounts) {
  // A blank wall whose rim has texture, in front of the house: the rim is where it ends. It is two cells wide, as some
  // directions step over every other one.
  for (int row = kRoof - 2 * kCell; row < kRoof; ++row) {
    for (int col = 0; col < kWidth; ++col) evidence_(col / kCell, row / kCell) = 50;
  }
  Check();
  EXPECT_EQ(CountUnsupported(0, kHeight), 0);
}

TEST_F(FreeSpaceCheckTest, ThinThingsInACellOfSomethingElseStay) {
  // A post one pixel wide, which its cells' middles do not show.
  for (int row = 0; row < kRoof; ++row) planes_(100, row) = At(5);
  Check();
  ASSERT_NE(MiddleOfCell(100 / kCell, kCell, kWidth), 100);
  for (int row = 0; row < kRoof; ++row) EXPECT_EQ(cost_(100, row), 0.3f) << row;
  EXPECT_EQ(CountUnsupported(0, kRoof), kRoof * (kWidth - 1));
}

/// Through the engines: a blank sky over a textured house front, in which all views see a nearer wall.
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
    for (PlanarView& view : views) {
      const PlanarView wall = RenderPlane(near, WaveTexture(1, 0.05, 1), view.camera, view.cam_from_world);
      for (int row = 0; row < kRoof; ++row) {
        for (int col = 0; col < kFineWidth; ++col) {
          view.depth(col, row) = wall.depth(col, row);
          view.gray(col, row) = static_cast<float>(150 + random(-1, 1));
        }
      }
    }
    EngineProblem problem = {{}, LoadViews(views, engine), {1, 20}};
    const CostMap cost(kFineWidth, kFineHeight, 0.3f);
    for (size_t i = 0; i < views.size(); ++i) {
      const Eigen::Vector3f normal = (views[i].cam_from_world.linear() * front.normal).cast<float>();
      const NormalMap normals(kFineWidth, kFineHeight, Vec3f{normal.x(), normal.y(), normal.z()});
      problem.sources[i].estimate =
          engine->UploadMaps({views[i].depth.View(), normals.View(), cost.View()}, views[i].camera);
    }
    problem.reference = problem.sources.front();
    problem.sources.erase(problem.sources.begin());
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
  // Of what is blank a hundredth may look textured (DepthEvidenceTest).
  EXPECT_GT(unsupported, 0.98 * kFineWidth * (kRoof - kRim));
  EXPECT_EQ(kept, (kFineHeight - 13 - kRoof - kRim) * (kFineWidth - 61));
}

TEST_P(FreeSpaceCheckOnEnginesTest, KeepsPlanesAndAStartThatIsHeld) {
  const EstimateState before = engine_->DownloadState(scene_.reference.estimate);
  const EstimateState expected = engine_->DownloadState(RemoveUnsupported());
  EXPECT_TRUE(SamePixels(expected.planes, before.planes));
  EXPECT_TRUE(SameBits(engine_->DownloadState(scene_.reference.estimate), before));
  const EngineEstimate* start = scene_.reference.estimate.get();
  const EngineEstimatePtr unsupported = engine_->RemoveUnsupported(scene_, std::move(scene_.reference.estimate));
  EXPECT_TRUE(GetParam() == Device::kCpu || unsupported.get() == start) << "nobody else held it";
  EXPECT_TRUE(SameBits(engine_->DownloadState(unsupported), expected));
}

}  // namespace
}  // namespace acmp
