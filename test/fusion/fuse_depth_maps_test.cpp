#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>

#include "fusion/analytic_views.h"
#include "fusion/error_text.h"
#include "fusion/reference_fusion.h"

namespace acmp {
namespace {

/// Four noisy views of a wall with a box front before it, of unequal sizes.
std::vector<TestView> NoisyViews() {
  const std::vector<Quad> quads = {{{0, 0, 5}, {9, 0, 3}, {0, 9, 1}, {200, 100, 50}},
                                   {{0.3, 0, 3}, {0.4, 0, 0.1}, {0, 0.5, 0}, {10, 20, 30}}};
  const PinholeCamera camera = {64, 48, 75, 76, 31.2, 24.4};
  std::vector<TestView> views;
  views.push_back(Render(camera, LookAt({0, 0, 0}, {0, 0, 5}), quads));
  views.push_back(Render(camera.Resized(90, 71), LookAt({0.8, 0.1, 0}, {0.1, 0, 5}), quads));
  views.push_back(Render(camera, LookAt({-0.7, -0.2, 0.3}, {0, 0.1, 5}), quads));
  views.push_back(Render(camera.Resized(50, 37), LookAt({0.1, 0.6, -0.4}, {0, 0, 5}), quads));
  std::mt19937 generator(2);
  std::normal_distribution<float> relative_noise(0, 0.004f), normal_noise(0, 0.05f);
  std::uniform_int_distribution<int> any_color(0, 255);
  for (TestView& view : views) {
    for (float& z : view.depth) z *= 1 + relative_noise(generator);
    for (Vec3f& n : view.normal) {
      n = Normalized(n + Vec3f{normal_noise(generator), normal_noise(generator), normal_noise(generator)});
    }
    for (Rgb& rgb : view.color) rgb.b = static_cast<unsigned char>(any_color(generator));
  }
  return views;
}

TEST(FuseDepthMaps, AgreesWithThePlainSerialReference) {
  const std::vector<TestView> views = NoisyViews();
  const std::vector<std::vector<int>> neighbors = {{1, 2, 3}, {0, 2}, {3, 1, 0}, {2, 0, 1}};
  for (const bool dynamic : {false, true}) {
    FusionOptions options;
    options.dynamic_consistency = dynamic;
    const PointCloud points = FuseDepthMaps(ViewsOf(views), neighbors, options);
    const std::vector<reference::Point> expected = reference::Fuse(ViewsOf(views), neighbors, options);
    ASSERT_EQ(points.size(), expected.size());
    ASSERT_GT(points.size(), 500u);
    for (size_t i = 0; i < points.size(); ++i) {
      // Coordinates up to 5 rounded to float in the camera frame and again in the world: 5e-7 each.
      ASSERT_NEAR(points[i].position.x, expected[i].position.x(), 3e-6) << i;
      ASSERT_NEAR(points[i].position.y, expected[i].position.y(), 3e-6) << i;
      ASSERT_NEAR(points[i].position.z, expected[i].position.z(), 3e-6) << i;
      ASSERT_NEAR(points[i].normal.x, expected[i].normal.x(), 1e-6);
      ASSERT_NEAR(points[i].normal.y, expected[i].normal.y(), 1e-6);
      ASSERT_NEAR(points[i].normal.z, expected[i].normal.z(), 1e-6);
      ASSERT_NEAR(points[i].color.b, expected[i].color.z(), 0.5);
      ASSERT_NEAR(points[i].confidence, expected[i].confidence, 1e-5);  // angles of a few degrees held in float
    }
  }
}

TEST(FuseDepthMaps, UsesEachPixelOnce) {
  // Views from one place see the same surface pixel by pixel: one point per pixel, not one per pixel and view.
  const TestView view = FlatView(40, 33, 4);
  const std::vector<FusionView> views(4, view.View());
  FusionOptions options;
  EXPECT_EQ(FuseDepthMaps(views, {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}}, options).size(), 40u * 33);
  // The first view uses up its only neighbour; the other two then confirm each other.
  options.min_consistent_views = 1;
  EXPECT_EQ(FuseDepthMaps(views, {{1}, {0}, {3}, {2}}, options).size(), 2u * 40 * 33);
  // A used pixel does not confirm others either: view 2 finds only used ones.
  EXPECT_EQ(FuseDepthMaps({views[0], views[1], views[2]}, {{1}, {0}, {0, 1}}, options).size(), 40u * 33);
}

TEST(FuseDepthMaps, DoesNotMarkPixelsOfRejectedPoints) {
  // View 0 has one confirming view of two required, so its pixels and those of view 1 stay free for view 3.
  const TestView near = FlatView(10, 10, 4), far = FlatView(10, 10, 8);
  const std::vector<FusionView> views = {near.View(), near.View(), far.View(), near.View()};
  EXPECT_EQ(FuseDepthMaps(views, {{1, 2}, {}, {}, {0, 1}}, {}).size(), 100u);
}

TEST(FuseDepthMaps, MarksWithinARowAtOnce) {
  // The reference is twice as fine as its source: pairs of its pixels share one source pixel, and the second of each
  // pair finds it used.
  TestView fine = FlatView(40, 1, 4), coarse = FlatView(20, 1, 4);
  coarse.camera.fx = 50;
  coarse.camera.cx = 9.5;
  FusionOptions options;
  options.min_consistent_views = 1;
  EXPECT_EQ(FuseDepthMaps({fine.View(), coarse.View()}, {{1}, {}}, options).size(), 20u);
}

TEST(FuseDepthMaps, GivesPointsInTheWorldFrame) {
  std::vector<TestView> views;
  const Quad wall = {{3, 2, 1}, {9, 0, 3}, {0, 9, 1}, {1, 2, 3}};
  const PinholeCamera camera = {40, 30, 45, 45, 19.5, 14.5};
  for (const Eigen::Vector3d& offset : {Eigen::Vector3d(0, 0, 0), {0.3, 0, 0}, {0, 0.3, 0.1}}) {
    views.push_back(Render(camera, LookAt(Eigen::Vector3d(2, 1, -4) + offset, wall.center), {wall}));
  }
  const PointCloud points = FuseDepthMaps(ViewsOf(views), {{1, 2}, {0, 2}, {0, 1}}, {});
  EXPECT_GT(points.size(), 800u);
  const Eigen::Vector3d normal = wall.side_a.cross(wall.side_b).normalized();
  for (const SurfacePoint& point : points) {
    const Eigen::Vector3d position(point.position.x, point.position.y, point.position.z);
    ASSERT_NEAR(normal.dot(position - wall.center), 0, 3e-6);  // depths near 5, rounded twice
    // The wall's normal turned to the cameras, which stand on the side of negative z.
    ASSERT_LT(point.normal.z, 0);
    ASSERT_NEAR(std::abs(normal.dot(Eigen::Vector3d(point.normal.x, point.normal.y, point.normal.z))), 1, 1e-6);
  }
}

TEST(FuseDepthMaps, HandlesEmptyInput) {
  EXPECT_TRUE(FuseDepthMaps({}, {}, {}).empty());
  const TestView view = FlatView(7, 5, 4);
  EXPECT_TRUE(FuseDepthMaps({view.View()}, {{}}, {}).empty());
  EXPECT_TRUE(FuseDepthMaps({FusionView(), FusionView()}, {{1}, {0}}, {}).empty());
  const std::vector<FusionView> views = {view.View(), FusionView(), view.View(), view.View()};
  EXPECT_EQ(FuseDepthMaps(views, {{1, 2, 3}, {0, 2}, {}, {}}, {}).size(), 35u);
}

TEST(FuseDepthMaps, RefusesBadNeighbors) {
  const TestView view = FlatView(7, 5, 4);
  const std::vector<FusionView> views(3, view.View());
  const auto error = [&](const std::vector<std::vector<int>>& neighbors) {
    return ErrorOf([&] { FuseDepthMaps(views, neighbors, {}); });
  };
  EXPECT_EQ(error({{1, 2}, {0}, {}}), "no error");
  EXPECT_THAT(error({{1}, {0}}), testing::HasSubstr("2 views but 3"));
  EXPECT_THAT(error({{3}, {}, {}}), testing::HasSubstr("neighbour 3 of view 0"));
  EXPECT_THAT(error({{}, {-1}, {}}), testing::HasSubstr("neighbour -1 of view 1"));
  EXPECT_THAT(error({{}, {}, {2}}), testing::HasSubstr("neighbour 2 of view 2"));
  EXPECT_THAT(error({{1, 2, 1}, {}, {}}), testing::HasSubstr("more than once"));
}

TEST(FuseDepthMaps, DoesNotDependOnTheNumberOfThreads) {
  const std::vector<TestView> views = NoisyViews();
  std::vector<PointCloud> clouds;
  for (const size_t threads : {1, 4}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    clouds.push_back(FuseDepthMaps(ViewsOf(views), {{1, 2, 3}, {0, 2}, {3, 1, 0}, {2, 0, 1}}, {}));
  }
  ASSERT_EQ(clouds[0].size(), clouds[1].size());
  for (size_t i = 0; i < clouds[0].size(); ++i) {
    const SurfacePoint &a = clouds[0][i], &b = clouds[1][i];
    ASSERT_TRUE(a.position.x == b.position.x && a.position.y == b.position.y && a.position.z == b.position.z);
    ASSERT_TRUE(a.normal.x == b.normal.x && a.color.b == b.color.b && a.confidence == b.confidence);
  }
}

}  // namespace
}  // namespace acmp
