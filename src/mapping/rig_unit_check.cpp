#include "acmp_mapping/mapping/rig_unit_check.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/kernel/window.h"

namespace acmp {
namespace {

constexpr int kHalfWindow = 4;  // px

/// Correlation of the windows around a pixel of one image and around where its surface, were it flat and facing the
/// camera, is seen in another; -1 where one has no texture or lies outside.
double Correlation(const Frame& keyframe, const Eigen::Vector2d& pixel, double depth, const Frame& companion,
                   const RigidTransform& companion_from_keyframe) {
  constexpr double kLeastVariance = 4;  // grey levels squared: above the noise of most cameras
  double n = 0, sum_a = 0, sum_b = 0, sum_aa = 0, sum_bb = 0, sum_ab = 0;
  for (int row = -kHalfWindow; row <= kHalfWindow; ++row) {
    for (int col = -kHalfWindow; col <= kHalfWindow; ++col) {
      const Eigen::Vector2d here = pixel + Eigen::Vector2d(col, row);
      const Eigen::Vector3d point = companion_from_keyframe * keyframe.camera.Unproject(here, depth);
      const Eigen::Vector2d there = companion.camera.Project(point);
      if (!(point.z() > 0) || !keyframe.camera.Contains(here) || !companion.camera.Contains(there)) return -1;
      const double a = SampleBilinear(keyframe.gray.View(), static_cast<float>(here.x()), static_cast<float>(here.y()));
      const double b =
          SampleBilinear(companion.gray.View(), static_cast<float>(there.x()), static_cast<float>(there.y()));
      n += 1, sum_a += a, sum_b += b, sum_aa += a * a, sum_bb += b * b, sum_ab += a * b;
    }
  }
  const double variance_a = sum_aa / n - sum_a * sum_a / (n * n), variance_b = sum_bb / n - sum_b * sum_b / (n * n);
  if (variance_a < kLeastVariance || variance_b < kLeastVariance) return -1;
  return (sum_ab / n - sum_a * sum_b / (n * n)) / std::sqrt(variance_a * variance_b);
}

}  // namespace

std::optional<std::string> RigUnitCheck::Add(const Frame& keyframe, const Frame& companion) {
  constexpr size_t kPerKeyframe = 100;                           // points
  constexpr int kEnough = 300;                                   // of all keyframes
  constexpr double kAlike = 0.8, kMany = 0.4, kClearlyMore = 2;  // correlation; share of the points; times as many
  constexpr int kGiven = kLengths / 2, kNear = 3;                // within 15 % it is what calibrations are off by
  if (decided_ || keyframe.landmarks_in_world.empty()) return std::nullopt;
  const RigidTransform companion_from_keyframe = companion.cam_from_world * keyframe.cam_from_world.inverse();
  const size_t step = 1 + keyframe.landmarks_in_world.size() / kPerKeyframe;
  for (size_t i = 0; i < keyframe.landmarks_in_world.size(); i += step) {
    const Eigen::Vector3d in_cam = keyframe.cam_from_world * keyframe.landmarks_in_world[i];
    if (!(in_cam.z() > 0)) continue;
    const Eigen::Vector2d pixel = keyframe.camera.Project(in_cam);
    bool is_seen = false;
    for (int length = 0; length < kLengths; ++length) {
      RigidTransform moved = companion_from_keyframe;
      moved.translation() *= std::pow(1.05, length - kGiven);
      const double correlation = Correlation(keyframe, pixel, in_cam.z(), companion, moved);
      is_seen = is_seen || correlation > -1;
      alike_[static_cast<size_t>(length)] += correlation > kAlike ? 1 : 0;
    }
    points_ += is_seen ? 1 : 0;
  }
  if (points_ < kEnough) return std::nullopt;
  decided_ = true;
  const int best = static_cast<int>(std::max_element(alike_.begin(), alike_.end()) - alike_.begin());
  const auto share = [&](int length) { return static_cast<double>(alike_[static_cast<size_t>(length)]) / points_; };
  if (std::abs(best - kGiven) <= kNear || share(best) < kMany || share(best) < kClearlyMore * share(kGiven)) {
    return std::nullopt;
  }
  return Concat("the source camera does not lie where the images say, in the unit of the poses: of ", points_,
                " sparse points ", std::lround(100 * share(kGiven)), " % look alike in both images, and ",
                std::lround(100 * share(best)), " % if it were ", std::pow(1.05, best - kGiven),
                " times as far away. Poses of a monocular frontend without an IMU are not in metres: multiply the "
                "translation of ~T_cam_source by that for this run, or go without source cameras");
}

}  // namespace acmp
