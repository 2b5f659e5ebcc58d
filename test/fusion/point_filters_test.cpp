// Which pixels become points: one check is made to fail at a time, and it must be the one that is counted. And means of
// points in voxels.

#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <random>

#include "acmp_mapping/engine/host_depth_engine.h"
#include "acmp_mapping/fusion/point_losses.h"
#include "acmp_mapping/fusion/voxel_map.h"
#include "fusion/engine_views.h"
#include "fusion/reference_fusion.h"
#include "support/error_text.h"

namespace acmp {
namespace {

constexpr size_t kPixels = 20 * 16;

/// A wall at 4, seen from three places 0.2 apart: 5 px.
std::vector<TestView> Views() {
  std::vector<TestView> views;
  for (int i = 0; i < 3; ++i) {
    views.push_back(FlatView(20, 16, 4));
    views.back().cam_from_world.translation().x() = -0.02 * i;
  }
  return views;
}

PointLosses Count(const std::vector<TestView>& views, const FusionOptions& options = PaperFusion(), int step = 1) {
  HostDepthEngine engine;
  std::vector<EngineView> sources = UploadViews(views, &engine);
  const EngineView reference = sources.front();
  sources.erase(sources.begin());
  return engine.CountLosses(reference, sources, options, step);
}

TEST(PointLosses, CountsPointsAsTheConsistencyCheckDoes) {
  const std::vector<TestView> views = Views();
  HostDepthEngine engine;
  const ConsistencyResult result = Filter(&engine, ViewsOf(views), PaperFusion());
  const PointLosses losses = Count(views);
  EXPECT_EQ(losses.pixels, kPixels);
  EXPECT_EQ(losses.points, result.points_in_camera.size());
  EXPECT_GT(losses.points, kPixels / 2);
  EXPECT_EQ(losses.points + losses.outside, kPixels) << "the last columns are outside the second source";
  EXPECT_EQ(Count(views, PaperFusion(), 4).pixels, 5u * 4);
}

TEST(PointLosses, NamesTheCheckThatFails) {
  struct Case {
    std::function<void(TestView*, int i)> change;  ///< a source, from 1 on
    size_t PointLosses::*loss;
    std::string description;
  };
  for (const Case& c :
       std::vector<Case>{{[](TestView*v, int) { v->depth = DepthMap(20, 16, 4.2f); },  // 5 %, less than 2 px
                          &PointLosses::relative_depth, "depth (1 %) "},
                         {[](TestView*v, int i) {
                            v->cam_from_world.translation().x() = -0.1 * i;
                            v->depth = DepthMap(20, 16, 2.0f);
                          },
                          &PointLosses::reprojection, "reprojection (2 px)"},
                         {[](TestView*v, int) {
                            v->normal = NormalMap(20, 16, {0.6f, 0, -0.8f});
                          },
                          &PointLosses::angle, "angle of normals (10 degrees)"},
                         {[](TestView*v, int) { v->depth = DepthMap(20, 16, 0.0f); }, &PointLosses::source_depth,
                          "no depth in the other images"}}) {
    std::vector<TestView> views = Views();
    for (int i = 1; i < 3; ++i) c.change(&views[static_cast<size_t>(i)], i);
    const PointLosses losses = Count(views);
    EXPECT_EQ(losses.points, 0u) << c.description;
    EXPECT_GT(losses.*c.loss, kPixels / 4) << c.description;
    EXPECT_THAT(Describe(losses, PaperFusion()), HasSubstr(c.description));
  }
  std::vector<TestView> views = Views();
  views[0].cost = CostMap(20, 16, 2.0f);
  EXPECT_EQ(Count(views).unconfirmed, kPixels);
  views[0].depth = DepthMap(20, 16, 0.0f);
  EXPECT_EQ(Count(views).without_depth, kPixels);
  EXPECT_THAT(Describe(Count(views), {}), AllOf(StartsWith("no depth 100 %"), HasSubstr("~depth_min")));
  views = Views();
  views.resize(1);
  EXPECT_EQ(Count(views).outside, kPixels) << "no source";
}

TEST(PointLosses, TellsWhatLacksConfidence) {
  // Every other three rows are 6 % farther: all is uneven, though the views agree.
  std::vector<TestView> views;
  for (int i = 0; i < 2; ++i) views.push_back(FlatView(20, 16, 4));
  for (TestView& view : views) {
    for (int row = 0; row < 16; ++row) {
      for (int col = 0; col < 20; ++col) view.depth(col, row) *= 1 + 0.06f * static_cast<float>(row / 3 % 2);
    }
  }
  const PointLosses losses = Count(views, {});
  EXPECT_EQ(losses.points + losses.uneven, kPixels);
  EXPECT_GT(losses.uneven, kPixels / 4);
  EXPECT_THAT(Describe(losses, {}), AllOf(StartsWith("confidence (0.35) though views agree "), HasSubstr("uneven")));
  views[0].cost = CostMap(20, 16, kWorstCost);
  EXPECT_EQ(Count(views, {}).unconfirmed, 0u);
  views[0].cost = CostMap(20, 16, kUnsupportedCost);
  EXPECT_EQ(Count(views, {}).unconfirmed, kPixels);
}

PointCloud RandomCloud(int count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> any(-1, 1), any_confidence(0, 1);
  std::uniform_int_distribution<int> any_color(0, 255);
  PointCloud points(count);
  for (SurfacePoint& point : points) {
    point.position = {any(generator), any(generator), any(generator)};
    point.normal = Normalized(Vec3f{any(generator), any(generator), 1.5f + any(generator)});
    point.color.r = static_cast<unsigned char>(any_color(generator));
    point.color.g = static_cast<unsigned char>(any_color(generator));
    point.color.b = static_cast<unsigned char>(any_color(generator));
    point.confidence = any_confidence(generator);
  }
  return points;
}

TEST(VoxelFilter, AgreesWithAPlainMap) {
  const PointCloud points = RandomCloud(5000, 1);
  const float size = 0.13f;
  struct Sum {
    double weight = 0, confidence = 0;
    Eigen::Vector3d position = {0, 0, 0}, normal = {0, 0, 0}, color = {0, 0, 0};
  };
  std::map<std::array<long, 3>, Sum> sums;
  for (const SurfacePoint& p : points) {
    const auto cell = [&](float x) { return std::lround(std::floor(static_cast<double>(x) / size)); };
    Sum& sum = sums[{cell(p.position.x), cell(p.position.y), cell(p.position.z)}];
    sum.position += p.confidence * Eigen::Vector3d(p.position.x, p.position.y, p.position.z);
    sum.normal += p.confidence * Eigen::Vector3d(p.normal.x, p.normal.y, p.normal.z);
    sum.color += p.confidence * Eigen::Vector3d(p.color.r, p.color.g, p.color.b);
    sum.weight += p.confidence;
    sum.confidence += p.confidence * p.confidence;
  }
  const PointCloud filtered = VoxelFilter(points, size);
  ASSERT_EQ(filtered.size(), sums.size());
  ASSERT_LT(filtered.size(), 4200u);
  size_t i = 0;
  for (const auto& [cell, sum] : sums) {  // the map is in the order of coordinates, too
    const SurfacePoint& p = filtered[i++];
    reference::ExpectNear(
        p, {sum.position / sum.weight, sum.normal.normalized(), sum.color / sum.weight, sum.confidence / sum.weight});
  }
}

SurfacePoint Point(float x, float normal_z, float confidence) {
  return {{x, 0.5f, 0.5f}, {0, 0, normal_z}, {100, 0, 0}, 0, confidence};
}

TEST(VoxelFilter, OrdersVoxelsOfAnyExtentByTheirCoordinates) {
  // A wall along each axis, scattered points far away (whose columns share a bucket), and one voxel for all.
  for (const Vec3f extent : {Vec3f{0, 50, 50}, Vec3f{50, 0, 50}, Vec3f{50, 50, 0}, Vec3f{2e9f, 2e9f, 2e9f},
                             Vec3f{2e9f, 0, 0}, Vec3f{0.1f, 0.1f, 0.1f}}) {
    PointCloud points = RandomCloud(20000, 8);
    for (SurfacePoint& point : points) {
      point.position = {point.position.x * extent.x, point.position.y * extent.y, point.position.z * extent.z};
    }
    std::map<std::array<double, 3>, int> voxels;
    const auto cell = [](const SurfacePoint& p) -> std::array<double, 3> {
      return {std::floor(p.position.x), std::floor(p.position.y), std::floor(p.position.z)};
    };
    for (const SurfacePoint& point : points) ++voxels[cell(point)];
    const PointCloud filtered = VoxelFilter(points, 1);
    ASSERT_EQ(filtered.size(), voxels.size());
    auto expected = voxels.begin();
    for (const SurfacePoint& mean : filtered) {
      if (expected->second == 1) {  // a mean of several may be rounded across the border
        ASSERT_EQ(cell(mean), expected->first);
      }
      ++expected;
    }
  }
}

TEST(VoxelFilter, AveragesPlainlyWhenNothingIsConfident) {
  const PointCloud filtered = VoxelFilter({Point(0.1f, 1, 0), Point(0.3f, 1, 0)}, 1);
  ASSERT_EQ(filtered.size(), 1u);
  EXPECT_NEAR(filtered[0].position.x, 0.2, 1e-6);
  EXPECT_EQ(filtered[0].confidence, 0);
  // One confident point outweighs any number of others.
  const PointCloud weighted = VoxelFilter({Point(0.1f, 1, 0), Point(0.3f, 1, 0.5f), Point(0.2f, 1, 0)}, 1);
  EXPECT_NEAR(weighted.at(0).position.x, 0.3, 1e-6);
}

TEST(VoxelFilter, KeepsTheStrongestNormalWhenNormalsCancel) {
  const PointCloud filtered = VoxelFilter({Point(0.1f, 1, 0.25f), Point(0.2f, -1, 0.5f), Point(0.3f, 1, 0.25f)}, 1);
  ASSERT_EQ(filtered.size(), 1u);
  EXPECT_EQ(filtered[0].normal.z, -1);
}

}  // namespace
}  // namespace acmp
