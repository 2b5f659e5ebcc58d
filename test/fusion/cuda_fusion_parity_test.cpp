#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>

#include "fusion/error_text.h"
#include "fusion/fuse_on_gpu.h"
#include "fusion/noisy_views.h"
#include "support/devices.h"

// CPU and GPU run the same source in double; what differs is that the GPU contracts to fused multiply-adds and that its
// exp, pow and atan2 may be off by another unit in the last place, 1e-16. A decision differs where an error lies
// that close to its limit, or a point falls that close to half-way between two pixels: with noise that never happens,
// so counts, order and number of points must be equal. Results are rounded to float, which turns such differences into
// none or one unit in the last place of a float.

namespace acmp {
namespace {

/// A unit in the last place of coordinates of 4 to 8, which are the largest here.
constexpr float kPositionTolerance = 4.8e-7f;
/// Of components of unit normals.
constexpr float kNormalTolerance = 6e-8f;
/// A unit in the last place of floats of 0.5 to 1.
constexpr float kConfidenceTolerance = 6e-8f;

class CudaFusionParityTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::unique_ptr<DepthEngine> engine;
    MakeEngineOrSkip(Device::kCuda, &engine);
  }
};

void ExpectSamePoints(const PointCloud& cpu, const PointCloud& cuda) {
  ASSERT_EQ(cpu.size(), cuda.size());
  for (size_t i = 0; i < cpu.size(); ++i) {
    const SurfacePoint &a = cpu[i], &b = cuda[i];
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

void ExpectSameResults(const ConsistencyResult& cpu, const ConsistencyResult& cuda) {
  ASSERT_EQ(cpu.consistent_views.width(), cuda.consistent_views.width());
  ASSERT_EQ(cpu.consistent_views.height(), cuda.consistent_views.height());
  for (int row = 0; row < cpu.consistent_views.height(); ++row) {
    for (int col = 0; col < cpu.consistent_views.width(); ++col) {
      ASSERT_EQ(cpu.consistent_views(col, row), cuda.consistent_views(col, row)) << col << ", " << row;
      ASSERT_NEAR(cpu.confidence(col, row), cuda.confidence(col, row), kConfidenceTolerance) << col << ", " << row;
    }
  }
  ExpectSamePoints(cpu.points_in_camera, cuda.points_in_camera);
}

void ExpectParity(const FusionView& reference, const std::vector<FusionView>& sources, const FusionOptions& options) {
  ExpectSameResults(FilterByConsistency(reference, sources, options),
                    FilterByConsistencyCuda(reference, sources, options));
}

void ExpectParity(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                  const FusionOptions& options) {
  ExpectSamePoints(FuseDepthMaps(views, neighbors, options), FuseDepthMapsCuda(views, neighbors, options));
}

std::vector<FusionView> SourcesOf(const std::vector<FusionView>& views) { return {views.begin() + 1, views.end()}; }

bool SameBits(const PointCloud& a, const PointCloud& b) {
  const auto same = [](const SurfacePoint& p, const SurfacePoint& q) {
    return p.position.x == q.position.x && p.position.y == q.position.y && p.position.z == q.position.z &&
           p.normal.x == q.normal.x && p.normal.y == q.normal.y && p.normal.z == q.normal.z && p.color.r == q.color.r &&
           p.color.g == q.color.g && p.color.b == q.color.b && p.confidence == q.confidence;
  };
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), same);
}

TEST_F(CudaFusionParityTest, NoisyViews) {
  const std::vector<TestView> views = NoisyViews();
  FusionOptions options;
  ASSERT_GT(FilterByConsistency(views[1].View(), ViewsOf(views), options).points_in_camera.size(), 100u);
  ExpectParity(views[0].View(), SourcesOf(ViewsOf(views)), options);
  ExpectParity(ViewsOf(views), NoisyNeighbors(), options);
}

TEST_F(CudaFusionParityTest, ConfidenceAloneIsThatOfTheFilter) {
  const std::vector<TestView> views = NoisyViews();
  const std::vector<FusionView> sources = SourcesOf(ViewsOf(views));
  const ConfidenceMap alone = MeasureConfidenceCuda(views[0].View(), sources, {});
  const ConfidenceMap expected = FilterByConsistencyCuda(views[0].View(), sources, {}).confidence;
  ASSERT_GT(*std::max_element(expected.begin(), expected.end()), 0.5f);
  EXPECT_TRUE(std::equal(alone.begin(), alone.end(), expected.begin(), expected.end()));
}

TEST_F(CudaFusionParityTest, TheSameBitsInEveryRun) {
  const std::vector<TestView> views = NoisyViews();
  const PointCloud first = FuseDepthMapsCuda(ViewsOf(views), NoisyNeighbors(), {});
  EXPECT_GT(first.size(), 500u);
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(SameBits(first, FuseDepthMapsCuda(ViewsOf(views), NoisyNeighbors(), {})));
  }
}

TEST_F(CudaFusionParityTest, SharesSourcePixelsWithinOneView) {
  // Three times as fine as its source: a source pixel goes into up to nine points, whose threads stamp it at once.
  const TestView fine = FlatView(120, 90, 4);
  TestView coarse = FlatView(40, 30, 4);
  coarse.camera = {40, 30, 100.0 / 3, 100.0 / 3, 19.5, 14.5};
  FusionOptions options;
  options.min_consistent_views = 1;
  const std::vector<FusionView> views = {fine.View(), coarse.View()};
  EXPECT_EQ(FuseDepthMapsCuda(views, {{1}, {0}}, options).size(), 120u * 90);
  ExpectParity(views, {{1}, {0}}, options);
}

TEST_F(CudaFusionParityTest, AllSizesOfBlocksAndScans) {
  // Around one block of 256 pixels; then above 1024 blocks, which the scan takes in several steps.
  std::mt19937 generator(4);
  for (const auto& [width, height] : {std::pair(1, 1), {255, 1}, {256, 1}, {257, 1}, {1, 300}, {64, 64}, {640, 480}}) {
    TestView view = FlatView(width, height, 4);
    for (float& z : view.depth) z = generator() % 3 == 0 ? 0 : z * (1 + 1e-3f * static_cast<float>(generator() % 8));
    const std::vector<FusionView> views(3, view.View());
    SCOPED_TRACE(Concat(width, " x ", height));
    ExpectParity(views[0], SourcesOf(views), {});
    ExpectParity(views, {{1, 2}, {0, 2}, {0, 1}}, {});
  }
}

TEST_F(CudaFusionParityTest, NoPointAndEveryPixelAPoint) {
  const TestView near = FlatView(70, 50, 4), far = FlatView(70, 50, 8);
  EXPECT_TRUE(FilterByConsistencyCuda(near.View(), {far.View(), far.View()}, {}).points_in_camera.empty());
  EXPECT_EQ(FilterByConsistencyCuda(near.View(), {near.View(), near.View()}, {}).points_in_camera.size(), 70u * 50);
  ExpectParity(near.View(), {far.View(), far.View()}, {});
  ExpectParity(near.View(), {near.View(), near.View()}, {});
}

TEST_F(CudaFusionParityTest, OddValues) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
  std::vector<TestView> views = NoisyViews();
  const float odd[] = {kNan, kInfinity, -kInfinity, -1.0f, 0.0f, 1e-38f, 1e38f};
  for (TestView& view : views) {
    const int pixels = static_cast<int>(view.depth.size());
    for (int k = 0; k < 7 * 15; ++k) {
      view.depth.data()[17 * k % pixels] = odd[k % 7];
      view.cost.data()[(17 * k + 3) % pixels] = odd[k % 7];
      view.normal.data()[(17 * k + 6) % pixels] = {odd[k % 7], odd[(k + 1) % 7], 0};
    }
  }
  FusionOptions loose;
  loose.max_normal_angle_deg = 170;
  loose.max_relative_depth = 0.99f;
  loose.min_consistent_views = 1;
  for (const FusionOptions& options : {FusionOptions(), loose}) {
    ExpectParity(views[0].View(), SourcesOf(ViewsOf(views)), options);
    ExpectParity(ViewsOf(views), NoisyNeighbors(), options);
  }
}

TEST_F(CudaFusionParityTest, PaddedRowsMissingColorsAndEmptyViews) {
  std::vector<TestView> views = NoisyViews();
  views[2].color = ColorImage();
  std::vector<FusionView> padded = ViewsOf(views);
  // The left part of view 0: its rows are further apart than they are long.
  padded[0].camera.width = padded[0].depth.width = padded[0].normal.width = padded[0].cost.width =
      padded[0].color.width = 41;
  padded.insert(padded.begin() + 1, FusionView());
  ExpectParity(padded[0], SourcesOf(padded), {});
  ExpectParity(padded, {{1, 2, 3, 4}, {0, 2}, {4, 1, 0}, {2, 0, 1}, {3, 2}}, {});

  EXPECT_TRUE(FuseDepthMapsCuda({}, {}, {}).empty());
  EXPECT_TRUE(FuseDepthMapsCuda({FusionView(), FusionView()}, {{1}, {0}}, {}).empty());
  EXPECT_TRUE(FilterByConsistencyCuda(FusionView(), {views[0].View()}, {}).confidence.empty());
  ExpectParity(views[0].View(), {}, {});
}

TEST_F(CudaFusionParityTest, AsManySourcesAsTheLimitAndOneMore) {
  const std::vector<TestView> views = NoisyViews();
  std::vector<FusionView> sources;
  sources.reserve(34);
  for (int i = 0; i < 32; ++i) sources.push_back(views[i % 4].View());
  ExpectParity(views[0].View(), sources, {});
  std::vector<std::vector<int>> neighbors(33);
  for (int i = 1; i <= 32; ++i) neighbors[0].push_back(i);
  neighbors[32] = {2, 0};
  sources.push_back(views[0].View());
  ExpectParity(sources, neighbors, {});
  EXPECT_THAT(ErrorOf([&] { FilterByConsistencyCuda(views[0].View(), sources, {}); }),
              testing::HasSubstr("number of source views = 33"));
  neighbors.emplace_back();
  neighbors[0].push_back(33);
  sources.push_back(views[0].View());
  EXPECT_THAT(ErrorOf([&] { FuseDepthMapsCuda(sources, neighbors, {}); }),
              testing::HasSubstr("number of neighbours of view 0 = 33"));
}

TEST_F(CudaFusionParityTest, RefusesWhatTheCpuRefuses) {
  const TestView good = FlatView(4, 3, 2);
  TestView bad = FlatView(4, 3, 2);
  bad.cost = CostMap();
  EXPECT_THAT(ErrorOf([&] { FilterByConsistencyCuda(good.View(), {bad.View()}, {}); }),
              testing::HasSubstr("source view 0: cost map is 0 x 0"));
  EXPECT_THAT(ErrorOf([&] {
                FuseDepthMapsCuda({good.View(), bad.View()}, {{1}, {0}}, {});
              }),
              testing::HasSubstr("view 1: cost map is 0 x 0"));
  EXPECT_THAT(ErrorOf([&] { FilterByConsistencyCuda(good.View(), {good.View()}, {}, 1000); }),
              testing::HasSubstr("index = 1000"));
}

}  // namespace
}  // namespace acmp
