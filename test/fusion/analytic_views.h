#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// As the papers fuse, with so many views: whatever agrees with them is a point.
inline FusionOptions PaperFusion(int min_consistent_views = 2) { return {0, min_consistent_views, 2, 0.01f, 10}; }

/// A parallelogram center + a * side_a + b * side_b, |a|, |b| <= 1, in the world.
struct Quad {
  Eigen::Vector3d center, side_a, side_b;
  Rgb color;
};

/// One image's maps; the pixels belong to the caller. Without a depth map it takes no part.
struct FusionView {
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
  ImageView<const float> depth;   ///< z, 0 = unknown
  ImageView<const Vec3f> normal;  ///< camera frame
  ImageView<const float> cost;
  ImageView<const Rgb> color;  ///< may be empty
};

/// A view that owns its maps.
struct TestView {
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
  ColorImage color;

  FusionView View() const { return {camera, cam_from_world, depth.View(), normal.View(), cost.View(), color.View()}; }
};

inline std::vector<FusionView> ViewsOf(const std::vector<TestView>& views) {
  std::vector<FusionView> result;
  result.reserve(views.size());
  for (const TestView& view : views) result.push_back(view.View());
  return result;
}

/// Camera at `center` that looks at `target`, y roughly down.
inline RigidTransform LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target) {
  const Eigen::Vector3d z = (target - center).normalized();
  const Eigen::Vector3d x = Eigen::Vector3d::UnitY().cross(z).normalized();
  RigidTransform cam_from_world = RigidTransform::Identity();
  cam_from_world.linear() << x.transpose(), z.cross(x).transpose(), z.transpose();
  cam_from_world.translation() = -cam_from_world.linear() * center;
  return cam_from_world;
}

/// True depth, normal and colour of the nearest quad per pixel, by intersecting rays in double; cost 0.
inline TestView Render(const PinholeCamera& camera, const RigidTransform& cam_from_world,
                       const std::vector<Quad>& quads) {
  TestView view{camera,
                cam_from_world,
                DepthMap(camera.width, camera.height),
                NormalMap(camera.width, camera.height),
                CostMap(camera.width, camera.height),
                ColorImage(camera.width, camera.height)};
  const RigidTransform world_from_cam = cam_from_world.inverse();
  const Eigen::Vector3d origin = world_from_cam.translation();
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector3d ray = world_from_cam.linear() * camera.Unproject({col, row});  // camera z = 1
      double nearest = std::numeric_limits<double>::infinity();
      for (const Quad& quad : quads) {
        // origin + z ray = center + a side_a + b side_b
        Eigen::Matrix3d system;
        system << ray, -quad.side_a, -quad.side_b;
        const Eigen::Vector3d hit = system.colPivHouseholderQr().solve(quad.center - origin);
        if (!(hit[0] > 0 && hit[0] < nearest) || std::abs(hit[1]) > 1 || std::abs(hit[2]) > 1) continue;
        nearest = hit[0];
        Eigen::Vector3d normal = cam_from_world.linear() * quad.side_a.cross(quad.side_b).normalized();
        if (normal.dot(camera.Unproject({col, row})) > 0) normal = -normal;
        const Eigen::Vector3f rounded = normal.cast<float>();
        view.depth(col, row) = static_cast<float>(nearest);
        view.normal(col, row) = {rounded.x(), rounded.y(), rounded.z()};
        view.color(col, row) = quad.color;
      }
    }
  }
  return view;
}

/// width x height pixels of one fronto-parallel plane seen from the identity pose; f = 100 px.
inline TestView FlatView(int width, int height, float depth) {
  TestView view{{width, height, 100, 100, 0.5 * (width - 1), 0.5 * (height - 1)},
                RigidTransform::Identity(),
                DepthMap(width, height, depth),
                NormalMap(width, height, {0, 0, -1}),
                CostMap(width, height),
                ColorImage(width, height)};
  return view;
}

/// Four noisy views of a wall with a box front before it, of unequal sizes.
inline std::vector<TestView> NoisyViews() {
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

/// Odd depths, costs and normals here and there.
inline void SpoilSomePixels(std::vector<TestView>* views) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const float odd[] = {kNan, kInfinity, -kInfinity, -1.0f, 0.0f, 1e-38f, 1e38f};
  for (TestView& view : *views) {
    const int pixels = static_cast<int>(view.depth.size());
    for (int k = 0; k < 7 * 15; ++k) {
      view.depth.data()[17 * k % pixels] = odd[k % 7];
      view.cost.data()[(17 * k + 3) % pixels] = odd[k % 7];
      view.normal.data()[(17 * k + 6) % pixels] = {odd[k % 7], odd[(k + 1) % 7], 0};
      view.normal.data()[(17 * k + 7) % pixels] = {0, 0, 0};
    }
  }
}

/// All other views, in no particular order, and for one view not all of them.
inline std::vector<std::vector<int>> NoisyNeighbors() { return {{1, 2, 3}, {0, 2}, {3, 1, 0}, {2, 0, 1}}; }

}  // namespace acmp
