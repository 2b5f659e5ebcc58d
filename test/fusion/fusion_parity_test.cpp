// CPU and GPU run the same source in double; what differs is that the GPU contracts to fused multiply-adds and that its
// exp, pow and atan2 may be off by another unit in the last place, 1e-16. A decision differs where an error lies
// that close to its limit, or a point falls that close to half-way between two pixels: with noise that never happens,
// so order and number of points must be equal. Results are rounded to float, which turns such differences into
// none or one unit in the last place of a float.

#include <algorithm>
#include <random>

#include "gtest/gtest.h"

#include "fusion/engine_views.h"
#include "fusion/noisy_views.h"

namespace acmp {
namespace {

/// A unit in the last place of coordinates of 4 to 8, which are the largest here.
constexpr float kPositionTolerance = 4.8e-7f;
/// Of components of unit normals.
constexpr float kNormalTolerance = 6e-8f;
/// A unit in the last place of floats of 0.5 to 1.
constexpr float kConfidenceTolerance = 6e-8f;

void ExpectSamePoints(const PointCloud& cpu, const PointCloud& gpu) {
  ASSERT_EQ(cpu.size(), gpu.size());
  for (size_t i = 0; i < cpu.size(); ++i) {
    const SurfacePoint &a = cpu[i], &b = gpu[i];
    ASSERT_NEAR(a.position.x, b.position.x, kPositionTolerance) << i;
    ASSERT_NEAR(a.position.y, b.position.y, kPositionTolerance) << i;
    ASSERT_NEAR(a.position.z, b.position.z, kPositionTolerance) << i;
    ASSERT_NEAR(a.normal.x, b.normal.x, kNormalTolerance) << i;
    ASSERT_NEAR(a.normal.y, b.normal.y, kNormalTolerance) << i;
    ASSERT_NEAR(a.normal.z, b.normal.z, kNormalTolerance) << i;
    ASSERT_NEAR(a.confidence, b.confidence, kConfidenceTolerance) << i;
    ASSERT_TRUE(a.color.r == b.color.r && a.color.g == b.color.g && a.color.b == b.color.b) << i;
  }
}

class FusionParityTest : public ::testing::Test {
 protected:
  void SetUp() override {
    cpu_ = MakeDepthEngine(Device::kCpu).engine;
    try {
      gpu_ = MakeDepthEngine(Device::kCuda).engine;
    } catch (const InvalidInputError& error) {
      GTEST_SKIP() << error.what();
    }
  }

  /// View 0 against all others.
  static ConsistencyResult Filter(DepthEngine* engine, const std::vector<FusionView>& views,
                                  const FusionOptions& options) {
    std::vector<EngineView> uploaded = UploadViews(views, engine);
    const EngineView reference = uploaded.front();
    uploaded.erase(uploaded.begin());
    ConsistencyResult result = engine->FilterByConsistency(reference, uploaded, options);
    const ConfidenceMap alone = engine->MeasureConfidence(reference, uploaded, options);
    EXPECT_TRUE(std::equal(alone.begin(), alone.end(), result.confidence.begin(), result.confidence.end()));
    return result;
  }

  void ExpectParity(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors) {
    for (const FusionOptions& options : {FusionOptions(), PaperFusion()}) ExpectParity(views, neighbors, options);
  }
  void ExpectParity(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                    const FusionOptions& options) {
    const ConsistencyResult cpu = Filter(cpu_.get(), views, options), gpu = Filter(gpu_.get(), views, options);
    for (size_t i = 0; i < cpu.confidence.size(); ++i) {
      ASSERT_NEAR(cpu.confidence.data()[i], gpu.confidence.data()[i], kConfidenceTolerance) << i;
    }
    ExpectSamePoints(cpu.points_in_camera, gpu.points_in_camera);
    ExpectSamePoints(FuseViews(cpu_.get(), views, neighbors, options),
                     FuseViews(gpu_.get(), views, neighbors, options));
  }

  std::unique_ptr<DepthEngine> cpu_, gpu_;
};

TEST_F(FusionParityTest, NoisyViews) {
  std::vector<TestView> views = NoisyViews();
  EXPECT_GT(FuseViews(gpu_.get(), ViewsOf(views), NoisyNeighbors(), PaperFusion()).size(), 500u);
  ExpectParity(ViewsOf(views), NoisyNeighbors());
  views[2].color = ColorImage();
  ExpectParity(ViewsOf(views), NoisyNeighbors());
}

TEST_F(FusionParityTest, SharesSourcePixelsWithinOneView) {
  // Three times as fine as its source: a source pixel goes into up to nine points, whose threads stamp it at once.
  const TestView fine = FlatView(120, 90, 4);
  TestView coarse = FlatView(40, 30, 4);
  coarse.camera = {40, 30, 100.0 / 3, 100.0 / 3, 19.5, 14.5};
  const std::vector<FusionView> views = {fine.View(), coarse.View()};
  EXPECT_EQ(FuseViews(gpu_.get(), views, {{1}, {0}}, PaperFusion(1)).size(), 120u * 90);
  for (const int min_views : {0, 1}) ExpectParity(views, {{1}, {0}}, PaperFusion(min_views));
}

TEST_F(FusionParityTest, AllSizesOfBlocksAndScans) {
  // Around one block of 256 pixels; then above 1024 blocks, which the scan takes in several steps.
  std::mt19937 generator(4);
  for (const auto& [width, height] : {std::pair(17, 15), {16, 16}, {19, 27}, {64, 64}, {640, 480}}) {
    TestView view = FlatView(width, height, 4);
    for (float& z : view.depth) z = generator() % 3 == 0 ? 0 : z * (1 + 1e-3f * static_cast<float>(generator() % 8));
    SCOPED_TRACE(Concat(width, " x ", height));
    ExpectParity(std::vector<FusionView>(3, view.View()), {{1, 2}, {0, 2}, {0, 1}});
  }
}

TEST_F(FusionParityTest, NoPointAndEveryPixelAPoint) {
  const TestView near = FlatView(70, 50, 4), far = FlatView(70, 50, 8);
  EXPECT_TRUE(Filter(gpu_.get(), {near.View(), far.View(), far.View()}, PaperFusion()).points_in_camera.empty());
  const std::vector<FusionView> same(3, near.View());
  EXPECT_EQ(Filter(gpu_.get(), same, PaperFusion()).points_in_camera.size(), 70u * 50);
  ExpectParity({near.View(), far.View(), far.View()}, {{1, 2}, {}, {}});
  ExpectParity({near.View()}, {{}});
}

TEST_F(FusionParityTest, OddValues) {
  std::vector<TestView> views = NoisyViews();
  SpoilSomePixels(&views);
  ExpectParity(ViewsOf(views), NoisyNeighbors());
  for (const int min_views : {0, 1}) ExpectParity(ViewsOf(views), NoisyNeighbors(), {0.05f, min_views, 2, 0.99f, 170});
}

TEST_F(FusionParityTest, AsManySourcesAsTheMatcherTakes) {
  const std::vector<TestView> views = NoisyViews();
  std::vector<FusionView> all;
  std::vector<std::vector<int>> neighbors(33);
  for (int i = 0; i <= 32; ++i) {
    all.push_back(views[static_cast<size_t>(i % 4)].View());
    if (i > 0) neighbors[0].push_back(i);
  }
  neighbors[32] = {2, 0};
  ExpectParity(all, neighbors);
}

}  // namespace
}  // namespace acmp
