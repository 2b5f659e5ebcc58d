#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "fusion/engine_views.h"
#include "fusion/fusion_contexts.h"
#include "fusion/noisy_views.h"
#include "fusion/reference_fusion.h"

namespace acmp {
namespace {

TEST(FuseViews, AgreesWithThePlainReference) {
  const std::vector<TestView> views = NoisyViews();
  for (const FusionOptions& options : {PaperFusion(), FusionOptions()}) {
    const PointCloud points = FuseViews(ViewsOf(views), NoisyNeighbors(), options);
    const std::vector<reference::Point> expected = reference::Fuse(ViewsOf(views), NoisyNeighbors(), options);
    ASSERT_EQ(points.size(), expected.size());
    ASSERT_GT(points.size(), 500u);
    for (size_t i = 0; i < points.size(); ++i) reference::ExpectNear(points[i], expected[i]);
  }
}

TEST(FuseViews, UsesNoPixelOfAnEarlierViewsPoints) {
  // Views from one place see the same surface pixel by pixel: one point per pixel, not one per pixel and view.
  const TestView view = FlatView(40, 33, 4);
  const std::vector<FusionView> views(4, view.View());
  for (const int min_views : {0, 2}) {
    const FusionOptions options = PaperFusion(min_views);
    EXPECT_EQ(FuseViews(views, {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}}, options).size(), 40u * 33);
  }
  // The first view uses up its only neighbour; the other two then confirm each other.
  EXPECT_EQ(FuseViews(views, {{1}, {0}, {3}, {2}}, PaperFusion(1)).size(), 2u * 40 * 33);
  // A used pixel does not confirm others either: view 2 finds only used ones. By probability it needs none.
  const std::vector<std::vector<int>> used_up = {{1}, {0}, {0, 1}};
  EXPECT_EQ(FuseViews({views[0], views[1], views[2]}, used_up, PaperFusion(1)).size(), 40u * 33);
  EXPECT_EQ(FuseViews({views[0], views[1], views[2]}, used_up, {}).size(), 2u * 40 * 33);
}

TEST(FuseViews, DoesNotDependOnTheOrderOfAViewsPixels) {
  const std::vector<TestView> views = NoisyViews();
  const PointCloud expected = FuseViews(ViewsOf(views), NoisyNeighbors(), {});
  FusionContexts contexts(ViewsOf(views), NoisyNeighbors(), {});
  std::mt19937 generator(3);
  PointCloud points;
  for (int i = 0; i < contexts.count(); ++i) {
    const int width = contexts[i].reference.depth.width, height = contexts[i].reference.depth.height;
    std::vector<int> order(width * height);
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), generator);
    std::vector<SurfacePoint> point_of_pixel(order.size());
    std::vector<char> accepted(order.size());
    for (const int k : order) {
      accepted[k] = FusePixel<kMaxFusionSources>(contexts[i], k % width, k / width, &point_of_pixel[k]);
    }
    for (size_t k = 0; k < order.size(); ++k) {
      if (accepted[k]) points.push_back(point_of_pixel[k]);
    }
  }
  EXPECT_EQ(FirstDifference(points, expected), "");
}

TEST(FuseViews, SharesSourcePixelsWithinOneView) {
  // The reference is twice as fine as its source: pairs of its pixels share one source pixel, which goes into the
  // points of both and is then used up.
  TestView fine = FlatView(40, 1, 4), coarse = FlatView(20, 1, 4);
  coarse.camera.fx = 50;
  coarse.camera.cx = 9.5;
  EXPECT_EQ(FuseViews({fine.View(), coarse.View()}, {{1}, {0}}, PaperFusion(1)).size(), 40u);
  // The other way about, each coarse pixel uses one fine one; the others have nobody left to confirm them.
  EXPECT_EQ(FuseViews({coarse.View(), fine.View()}, {{1}, {0}}, PaperFusion(1)).size(), 20u);
}

TEST(FuseViews, GivesPointsInTheWorldFrame) {
  std::vector<TestView> views;
  const Quad wall = {{3, 2, 1}, {9, 0, 3}, {0, 9, 1}, {1, 2, 3}};
  const PinholeCamera camera = {40, 30, 45, 45, 19.5, 14.5};
  for (const Eigen::Vector3d& offset : {Eigen::Vector3d(0, 0, 0), {0.3, 0, 0}, {0, 0.3, 0.1}}) {
    views.push_back(Render(camera, LookAt(Eigen::Vector3d(2, 1, -4) + offset, wall.center), {wall}));
  }
  const PointCloud points = FuseViews(ViewsOf(views), {{1, 2}, {0, 2}, {0, 1}}, {});
  EXPECT_GT(points.size(), 800u);
  const Eigen::Vector3d normal = wall.side_a.cross(wall.side_b).normalized();
  for (const SurfacePoint& point : points) {
    const Eigen::Vector3d position(point.position.x, point.position.y, point.position.z);
    ASSERT_NEAR(normal.dot(position - wall.center), 0, 3e-6);  // depths near 5
    // The wall's normal turned to the cameras, which stand on the side of negative z.
    ASSERT_LT(point.normal.z, 0);
    ASSERT_NEAR(std::abs(normal.dot(Eigen::Vector3d(point.normal.x, point.normal.y, point.normal.z))), 1, 1e-6);
  }
}

}  // namespace
}  // namespace acmp
