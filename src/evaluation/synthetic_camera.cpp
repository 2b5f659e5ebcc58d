#include "synthetic_camera.h"

#include <algorithm>

#include "synthetic_texture.h"

namespace acmp {
namespace {

// Tangent-half-angle form: smooth, exact to rounding, no libm.
Yaw YawOf(double half_angle_tangent) {
  const double q = half_angle_tangent * half_angle_tangent;
  return {(1.0 - q) / (1.0 + q), 2.0 * half_angle_tangent / (1.0 + q)};
}

// Value in -1..1 that drifts with a period of a few keyframes.
double Sway(uint32_t seed, uint32_t axis, int index) {
  return 2.0 * ValueNoise(seed * 977u + axis, {0.37 * index + 0.5, 0.5, 0.5}) - 1.0;
}

// Looks at the target, level but for a roll of up to 2.3 degrees.
CameraPose LookAt(const Vec3d& center, const Vec3d& target, double roll_sway) {
  CameraPose pose;
  pose.center = center;
  pose.forward = Normalized(target - center);
  const Vec3d level_right = Normalized(Cross(pose.forward, {0, 0, 1}));
  const Vec3d level_down = Cross(pose.forward, level_right);
  const Yaw roll = YawOf(0.02 * roll_sway);
  pose.right = roll.cos * level_right + roll.sin * level_down;
  pose.down = roll.cos * level_down - roll.sin * level_right;
  return pose;
}

CameraPose PoseOn(const HandHeldPath& path, int index, int count, uint32_t seed) {
  constexpr int kPerArc = 14;
  constexpr int kArcs = 3;  // heights: there and back again, then repeated with another sway
  const int per_arc = std::min(count, kPerArc);
  const int arc = index / per_arc;
  const int step = arc % 2 == 0 ? index % per_arc : per_arc - 1 - index % per_arc;
  const int cycle = arc % (2 * kArcs - 2);
  const int level = cycle < kArcs ? cycle : 2 * kArcs - 2 - cycle;

  const Yaw angle = YawOf(path.tan_per_step * (step - 0.5 * (per_arc - 1)));
  const double radius = path.orbit_m + 0.05 * Sway(seed, 1, index);
  const double height = 1.42 + 0.22 * level + 0.06 * Sway(seed, 2, index);
  const Vec3d center = {path.target.x + radius * angle.sin + 0.02 * Sway(seed, 3, index),
                        path.target.y - radius * angle.cos, height};
  const Vec3d target = path.target + Vec3d{0.06 * Sway(seed, 4, index), 0.0, 0.05 * Sway(seed, 5, index)};
  return LookAt(center, target, Sway(seed, 6, index));
}

CameraPose PoseOn(const StraightPath& path, int index, int /*count*/, uint32_t seed) {
  const int cycle = index % (2 * path.steps);
  const int step = cycle <= path.steps ? cycle : 2 * path.steps - cycle;
  constexpr double kTarget_m = 20;  // looked at ahead
  const Vec3d on_path = path.start + Vec3d{0, path.step_m * (step + 0.2 * Sway(seed, 1, index)), 0};
  const Vec3d center = on_path + Vec3d{0.15 * Sway(seed, 3, index), 0, 0.05 * Sway(seed, 2, index)};
  const Vec3d target = on_path + Vec3d{1.2 * Sway(seed, 4, index), kTarget_m, 0.5 * Sway(seed, 5, index)};
  return LookAt(center, target, 0.3 * Sway(seed, 6, index));
}

}  // namespace

CameraPose PoseOnPath(const CameraPath& path, int index, int count, uint32_t seed) {
  return std::visit([&](const auto& kind) { return PoseOn(kind, index, count, seed); }, path);
}

PinholeCamera SyntheticCamera(int width, int height) {
  constexpr double kFocalPerWidth = 0.8660254037844386;  // 0.5 / tan(30 degrees)
  return {
      width, height, kFocalPerWidth * width, 1.004 * kFocalPerWidth * width, 0.508 * width - 0.5, 0.494 * height - 0.5};
}

Ray PixelRay(const PinholeCamera& camera, const CameraPose& pose, double col, double row) {
  const double x = (col - camera.cx) / camera.fx;
  const double y = (row - camera.cy) / camera.fy;
  return {pose.center, x * pose.right + y * pose.down + pose.forward};
}

}  // namespace acmp
