#include "acmp_mapping/mesh/splat_points.h"

#include <gtest/gtest.h>

#include "acmp_mapping/fusion/voxel_map.h"
#include "mesh/sphere_views.h"

namespace acmp::test {
namespace {

constexpr double kSpacing = 0.02;

/// The points of a view in its camera's frame, thinned as in a map.
PointCloud PointsOf(const SurfaceMaps& view) {
  PointCloud points;
  for (int row = 0; row < view.depth.height(); ++row) {
    for (int col = 0; col < view.depth.width(); ++col) {
      const double depth = view.depth(col, row);
      if (depth == 0) continue;
      const Eigen::Vector3d p = view.camera.camera.Unproject({col, row}, depth);
      points.push_back({{static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())},
                        view.normal(col, row),
                        view.color(col, row),
                        view.confidence(col, row)});
    }
  }
  return VoxelFilter(points, static_cast<float>(kSpacing));
}

TEST(SplatPoints, GivesTheSurfaceBackWithoutGaps) {
  const SurfaceMaps seen = SeeSphere({1.5, 0, 0});
  const RigidTransform world_from_cam = seen.camera.cam_from_world.inverse();
  const SurfaceMaps maps = SplatPoints(PointsOf(seen), world_from_cam, kSpacing);
  const PinholeCamera& camera = maps.camera.camera;
  size_t known = 0, middle = 0;
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const double depth = maps.depth(col, row);
      const Eigen::Vector3d ray = camera.Unproject({col, row});
      if (std::hypot(ray.x(), ray.y()) < 0.25) {
        ++middle;
        EXPECT_GT(depth, 0) << "a gap at " << col << ", " << row;
      }
      if (depth == 0) continue;
      ++known;
      EXPECT_NEAR((world_from_cam * (depth * ray)).norm(), kSphereRadius, kSpacing) << col << ", " << row;
      EXPECT_EQ(maps.color(col, row).r, kSphereColor.r);
      EXPECT_NEAR(maps.confidence(col, row), 0.9f, 1e-5f);
    }
  }
  EXPECT_GT(middle, 200u);
  EXPECT_GT(known, middle);
}

TEST(SplatPoints, DrawsPointsThatAreNotApartOnce) {
  const SurfacePoint near = {{0, 0, 1e-4f}, {0, 0, -1}, {9, 8, 7}, 0.5f};  // over the whole image
  const PosedCamera camera = {{200, 150, 200, 200, 100, 75}, RigidTransform::Identity()};
  const SurfaceMaps one = SplatPoints({near}, camera, kSpacing);
  const SurfaceMaps many = SplatPoints(PointCloud(1000000, near), camera, kSpacing);  // minutes, if all are drawn
  ASSERT_EQ(many.depth.size(), one.depth.size());
  EXPECT_TRUE(std::equal(many.depth.begin(), many.depth.end(), one.depth.begin()));
  EXPECT_GT(many.depth(100, 75), 0);
}

TEST(SplatPoints, LeavesOutWhatNoCameraSees) {
  const PointCloud points = {{{0, 0, -1}, {0, 0, -1}, {}, 1}, {{10, 0, 1}, {0, 0, -1}, {}, 1}};
  EXPECT_TRUE(SplatPoints(points, RigidTransform::Identity(), kSpacing).depth.empty());
  EXPECT_TRUE(SplatPoints({}, RigidTransform::Identity(), kSpacing).depth.empty());
  const PointCloud one = {{{0, 0, 1}, {0, 0, -1}, {9, 8, 7}, 0.5f}};
  const SurfaceMaps maps = SplatPoints(one, RigidTransform::Identity(), kSpacing);
  EXPECT_EQ(maps.depth.size(), 1u);
  EXPECT_NEAR(maps.depth(0, 0), 1, 1e-6);
}

}  // namespace
}  // namespace acmp::test
