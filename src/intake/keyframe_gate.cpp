#include "acmp_mapping/intake/keyframe_gate.h"

#include <algorithm>

namespace acmp {
namespace {

constexpr double kSameView = 0.8;  ///< of the image that both see

/// Share of the image that the other camera sees, if everything is at this depth.
double SharedView(const RigidTransform& other_from_cam, const PinholeCamera& camera, double depth) {
  constexpr int kSteps = 8;  ///< per axis
  int shared = 0;
  for (int row = 0; row < kSteps; ++row) {
    for (int col = 0; col < kSteps; ++col) {
      const Eigen::Vector2d pixel((col + 0.5) / kSteps * camera.width - 0.5,
                                  (row + 0.5) / kSteps * camera.height - 0.5);
      const Eigen::Vector3d point = other_from_cam * camera.Unproject(pixel, depth);
      shared += point.z() > 0 && camera.Contains(camera.Project(point));
    }
  }
  return static_cast<double>(shared) / (kSteps * kSteps);
}

}  // namespace

bool KeyframeGate::Accept(const RigidTransform& world_from_cam, const PinholeCamera& camera, double median_depth) {
  const double min_baseline = median_depth > 0 ? options_.min_baseline_ratio * median_depth : 0;
  const auto is_near = [&](const RigidTransform& keyframe) {
    const double baseline = (keyframe.translation() - world_from_cam.translation()).norm();
    return baseline == 0 || baseline < min_baseline;
  };
  const auto shows_the_same = [&](const RigidTransform& keyframe) {
    return is_near(keyframe) &&
           (median_depth <= 0 || SharedView(keyframe.inverse() * world_from_cam, camera, median_depth) >= kSameView);
  };
  if (!keyframes_.empty() &&
      (is_near(keyframes_.back()) || std::any_of(keyframes_.begin(), keyframes_.end(), shows_the_same))) {
    return false;
  }
  keyframes_.push_back(world_from_cam);
  while (keyframes_.size() > options_.remembered) keyframes_.pop_front();
  return true;
}

}  // namespace acmp
