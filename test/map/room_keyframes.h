#pragma once

#include <algorithm>
#include <cstring>
#include <memory>
#include <vector>

#include "acmp_mapping/fusion/voxel_map.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {

/// All fields of all points, without padding.
inline bool SameBytes(const PointCloud& a, const PointCloud& b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](const auto& p, const auto& q) {
           return std::memcmp(&p.position, &q.position, sizeof(Vec3f)) == 0 && p.confidence == q.confidence &&
                  p.label == q.label && std::memcmp(&p.normal, &q.normal, sizeof(Vec3f)) == 0 &&
                  std::memcmp(&p.color, &q.color, sizeof(Rgb)) == 0;
         });
}

}  // namespace acmp

namespace acmp::test {

/// The points of a view's pixels in its camera's frame, at factor() times the true depth.
template <class Factor>
PointCloud PointsOf(const SyntheticView& view, const Factor& factor) {
  PointCloud points;
  const PinholeCamera& camera = view.frame.camera;
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      if (!(view.true_depth(col, row) > 0)) continue;
      const double depth = factor() * view.true_depth(col, row);
      const Eigen::Vector3f p = camera.Unproject({col, row}, depth).cast<float>();
      points.push_back({{p.x(), p.y(), p.z()},
                        view.true_normal(col, row),
                        view.frame.color(col, row),
                        view.true_labels(col, row),
                        0.9f});
    }
  }
  return points;
}

/// The synthetic room's views as a map has them: true points, one per voxel.
inline PlacedKeyframes RoomKeyframes(const std::vector<SyntheticView>& views, double voxel_size) {
  PlacedKeyframes map;
  map.voxel_size = voxel_size;
  for (const SyntheticView& view : views) {
    const PointCloud points = PointsOf(view, [] { return 1.0; });
    map.keyframes.push_back({view.frame.cam_from_world.inverse(), 1,
                             std::make_shared<const PackedCloud>(VoxelFilter(points, static_cast<float>(voxel_size)))});
  }
  return map;
}

}  // namespace acmp::test
