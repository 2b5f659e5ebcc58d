#pragma once

#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

/// Start-up check for the commonest wiring mistake, wrong pose conventions: with right ones most sparse points lie in
/// front of the camera. Tries the other readings of the same numbers and tells which one fits.
class ConventionCheck {
 public:
  /// After so many it judges first, and again each time that they have doubled, up to kLastKeyframes: near the world's
  /// origin a pose and its inverse are nearly the same. Those without sparse points do not count.
  static constexpr int kKeyframes = 5;
  static constexpr int kLastKeyframes = 40;

  /// One keyframe: its pose as received and its cloud, which is taken to be in the camera's frame or the world's.
  /// `cloud_received` is the pose at the cloud's stamp. Returns a warning, once, if the configured reading is
  /// implausible or another one puts clearly more points into the image.
  std::optional<std::string> Add(const PoseSemantics& configured, const RigidTransform& cloud_received,
                                 const SparseCloud& cloud, bool cloud_in_camera, const PinholeCamera& camera);

  /// The warning that was returned; empty: none.
  const std::string& warning() const { return warning_; }

  /// Share of the points in front of the camera, as configured, 0..1; none before the first point.
  std::optional<double> share_in_front() const;

 private:
  /// One way to read the numbers, and what it makes of the points.
  struct Reading {
    std::string name;  ///< the parameters to set
    size_t in_front = 0;
    size_t in_image = 0;
  };
  void Count(const std::string& name, const RigidTransform& cam_from_cloud, const SparseCloud& cloud,
             const PinholeCamera& camera);
  double Share(size_t count) const { return static_cast<double>(count) / static_cast<double>(points_); }
  std::optional<std::string> Judge(const PoseSemantics& configured) const;

  int keyframes_ = 0;
  std::string warning_;
  size_t points_ = 0;
  std::vector<Reading> readings_;  ///< the configured one first
};

}  // namespace acmp
