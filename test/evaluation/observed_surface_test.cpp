#include "acmp_mapping/evaluation/cloud_metrics.h"

#include <cmath>
#include <limits>
#include <map>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {
namespace {

using testing::ElementsAre;

SurfacePoint PointAt(float x, float y, float z) {
  SurfacePoint point = {};
  point.position = {x, y, z};
  return point;
}

// 4 x 3 px with a field of view of 90 degrees across; a pixel is half a metre wide at 1 m.
PinholeCamera WideCamera() { return {4, 3, 2, 2, 1.5, 1.0}; }

TEST(ObservedSurface, ObservesUpToTheSurfaceAndTheTolerance) {
  const float z = 2.0f;
  DepthMap depth(4, 3, z);
  depth(0, 0) = 0;
  depth(1, 0) = std::numeric_limits<float>::quiet_NaN();
  const auto at_pixel = [](float col, float row, float d) {
    return PointAt((col - 1.5f) / 2.0f * d, (row - 1.0f) / 2.0f * d, d);
  };
  const PointCloud points = {
      at_pixel(2, 1, 0.5f),      // in front
      at_pixel(2, 1, z),         // on
      at_pixel(2, 1, 2.25f),     // behind, as far as the tolerance
      at_pixel(2, 1, 2.26f),     // hidden
      at_pixel(0, 0, 1.0f),      // unknown depth
      at_pixel(1, 0, 1.0f),      // the same, written as NaN
      at_pixel(2, 1, -1.0f),     // behind the camera
      at_pixel(3.49f, 1, 1.0f),  // the last column's outer half
      at_pixel(3.51f, 1, 1.0f),  // outside
      at_pixel(-0.5f, 1, 1.0f),  // the first column's outer border
      at_pixel(1.51f, 0, 1.0f),  // nearest to a known pixel
      at_pixel(1.49f, 0, 1.0f),  // nearest to an unknown one
  };
  ObservedSurface surface(points, 0.01, 0.25);
  surface.Add(depth, WideCamera(), RigidTransform::Identity());
  EXPECT_THAT(surface.observed(), ElementsAre(1, 1, 1, 0, 0, 0, 0, 1, 0, 1, 1, 0));
  EXPECT_EQ(surface.cloud().size(), 10u);
}

TEST(ObservedSurface, OneMapThatObservesIsEnough) {
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.translation() = Eigen::Vector3d(0, 0, 10);
  world_from_cam.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()));  // looks back
  const PointCloud points = {PointAt(0, 0, 1), PointAt(0, 0, 5), PointAt(0, 0, 9)};
  ObservedSurface surface(points, 0.01, 0.1);
  surface.Add(DepthMap(4, 3, 2.0f), WideCamera(), RigidTransform::Identity());
  EXPECT_THAT(surface.observed(), ElementsAre(1, 0, 0));
  surface.Add(DepthMap(4, 3, 2.0f), WideCamera(), world_from_cam.inverse());
  EXPECT_THAT(surface.observed(), ElementsAre(1, 0, 1));
}

TEST(ObservedSurface, KeepsTheFirstPointOfEachVoxel) {
  SyntheticSceneOptions options;
  options.width = 60;
  options.height = 45;
  options.keyframes = 3;
  const std::vector<SyntheticView> views = MakeSyntheticScene(options);
  constexpr double kSpacing = 0.06;
  std::map<std::tuple<double, double, double>, Eigen::Vector3f> first;
  const PointCloud nothing;
  ObservedSurface surface(nothing, kSpacing, 0.1);
  size_t pixels = 0;
  for (const SyntheticView& view : views) {
    const Frame& frame = view.frame;
    surface.Add(view.true_depth, frame.camera, frame.cam_from_world);
    for (int row = 0; row < options.height; ++row) {
      for (int col = 0; col < options.width; ++col, ++pixels) {
        const Eigen::Vector3d in_cam = frame.camera.Unproject({col, row}, view.true_depth(col, row));
        const Eigen::Vector3f p = (frame.cam_from_world.inverse() * in_cam).cast<float>();
        first.insert({{std::floor(p.x() / kSpacing), std::floor(p.y() / kSpacing), std::floor(p.z() / kSpacing)}, p});
      }
    }
  }
  ASSERT_EQ(surface.cloud().size(), first.size());
  EXPECT_LT(first.size(), pixels * 2 / 3);
  for (const SurfacePoint& point : surface.cloud()) {
    const Vec3f& p = point.position;
    const auto found = first.find({std::floor(p.x / kSpacing), std::floor(p.y / kSpacing), std::floor(p.z / kSpacing)});
    ASSERT_NE(found, first.end());
    EXPECT_EQ(found->second, Eigen::Vector3f(p.x, p.y, p.z));
  }
}

}  // namespace
}  // namespace acmp
