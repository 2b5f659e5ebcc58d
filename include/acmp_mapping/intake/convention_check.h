#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <unordered_set>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

/// Start-up check for a wrong ~sparse_frame, and for poses that are read wrongly: with right ones the points that a
/// frontend has just added to its cloud lie in the image. (Of the others nothing is known: a cloud may be the whole
/// map.) Which other reading of the poses fits the images tell (JudgeReadings).
class ConventionCheck {
 public:
  /// It judges by the later half of the new points: first of so many, and again each time that they have doubled. All
  /// new points of a cloud together count as kOfACloud at most.
  static constexpr double kFirstPoints = 100, kLastPoints = 800, kOfACloud = 20;

  /// One keyframe: its pose as received and its cloud, which is taken to be in the camera's frame or the world's.
  /// `cloud_received` is the pose at the cloud's stamp. Returns a warning, once, if the other frame puts clearly more
  /// points into the image, or neither does and most points lie behind the camera.
  std::optional<std::string> Add(const PoseSemantics& configured, const RigidTransform& cloud_received,
                                 const SparseCloud& cloud, bool cloud_in_camera, const PinholeCamera& camera);

  /// The warning that was returned; empty: none.
  const std::string& warning() const { return warning_; }

  /// Share of the points in front of the camera, as configured, 0..1; none before the first point.
  std::optional<double> share_in_front() const;

 private:
  /// New points, and how many of them lie before the camera and in the image.
  struct Look {
    double points = 0, in_front = 0, in_image = 0;
    double in_image_otherwise = 0;  ///< with the other frame of the cloud
  };
  /// Where a cloud has points, in cells of a size.
  using Cells = std::unordered_set<uint64_t>;

  /// Points of the cloud near which the one before had none, at most some thousand. None of the first cloud.
  std::vector<Eigen::Vector3d> TakeNew(const SparseCloud& cloud);
  std::optional<std::string> Judge(const PoseSemantics& configured, bool cloud_in_camera);

  int clouds_ = 0;                           ///< seen
  double new_points_ = 0;                    ///< of all clouds
  double next_points_ = 0.4 * kFirstPoints;  ///< when recent_ begins anew
  Look recent_;
  bool decided_ = false;
  std::string warning_;
  size_t points_ = 0, in_front_ = 0;  ///< of all clouds, as configured
  double cell_ = 0;
  Cells before_;  ///< of the cloud before
};

}  // namespace acmp
