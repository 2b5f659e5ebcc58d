#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/geometry/similarity.h"

namespace acmp {

/// A pose and the stamp of its image.
struct StampedPose {
  int64_t stamp_ns = 0;
  RigidTransform pose = RigidTransform::Identity();
};

/// How a pose of the frontend's optimized path becomes the pose of a capture.
struct PathConvention {
  bool maps_world_to_child = false;  ///< the path has T_child_world, else T_world_child
  /// T_child_cam: maps points of the capture's camera to the frame whose poses the path has. None while it is not
  /// known: then the path says nothing of the capture.
  std::optional<RigidTransform> child_from_cam = RigidTransform::Identity();
  int64_t tolerance_ns = 1000000;  ///< greatest distance between the stamps of pose and capture
};

/// A capture's pose as received and as corrected by loop closures.
struct CorrectedPose {
  int64_t stamp_ns = 0;
  size_t trajectory = 0;  ///< of which mapper
  PathConvention path;
  RigidTransform received = RigidTransform::Identity();            ///< world_from_capture of the pose input
  RigidTransform world_from_capture = RigidTransform::Identity();  ///< in use
  double scale = 1;                                                ///< in use, of its points
  Similarity correction;                                           ///< corrected world from received world
  bool named = false;                                              ///< a path had a pose of its stamp
  bool seeded = false;                                             ///< named, or took the correction of one that was

  double reach = 0;  ///< of the farthest point that it had from its camera, at most, before `scale`, unit of the poses

  /// Where what the mapper put at `sent` (world_from_capture) lies now, and the scale of its points.
  Similarity Placed(const RigidTransform& sent) const {
    return {sent.matrix() == received.matrix() ? world_from_capture : correction.Moved(sent), scale};
  }
};

/// Poses that differ by less are the same; otherwise a frontend's rounding would make a new map at every path.
struct PoseTolerance {
  double translation = 0;  ///< unit of the poses
  double rotation_rad = 0;
  double scale = 0;  ///< relative
};

/// Where captures and their points may lie.
struct Surroundings {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  double max_distance = 0;  ///< from it, unit of the poses, > 0
};

/// What a path did.
struct ReposeResult {
  /// Smallest distance in time of a capture to a pose, and that capture's tolerance.
  struct Gap {
    int64_t gap_ns = 0;
    int64_t tolerance_ns = 0;
  };
  /// What would put a capture or its points too far away.
  struct TooFar {
    int64_t stamp_ns = 0;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< of the path's pose, or of the capture moved with others
    Surroundings allowed;
  };
  std::vector<size_t> moved;   ///< captures that have another pose now: their places in the list
  size_t named = 0;            ///< captures that the path has a pose for
  size_t unresolved = 0;       ///< captures whose T_child_cam is not known
  size_t unmatched = 0;        ///< poses of the path that belong to no capture
  std::optional<Gap> nearest;  ///< none without captures or poses
  size_t too_far = 0;          ///< captures that stay where they are, since they would go too far away
  std::optional<TooFar> first_too_far;
};

/// Corrects captures that share a path, given in the order of their stamps, by that path, sorted.
///
/// A capture that the path names gets the pose of the path. One that it does not name keeps what an earlier path gave
/// it. One that was never named moves rigidly with the nearest earlier one that was, or, before the first of these,
/// with the first: over short times odometry is more accurate than anything one could interpolate, and a neighbouring
/// capture sees the same surfaces, which must not come apart. Corrections start from the received poses, so the same
/// path again changes nothing, and the order in which captures and paths come does not matter.
///
/// A path may have another scale, which may change along it: steps from one named capture of a trajectory to the next,
/// five to each side, are compared with those before. Where three quarters of the ratios agree within 10 % and their
/// median is off 1 by more than 2 %, it is the scale of the capture, also of its points. Else that is 1, since a
/// correction of poses alone changes distances as well.
///
/// A pose of the path that would put a capture's points too far away is taken as if it were not there; a capture that
/// others would move so far stays where it is. Both are counted (too_far).
ReposeResult Repose(const std::vector<StampedPose>& path, const PoseTolerance& same, const Surroundings& allowed,
                    const std::vector<CorrectedPose*>& captures);

}  // namespace acmp
