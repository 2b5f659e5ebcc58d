#pragma once

#include <optional>
#include <string>

#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// What the numbers of a pose message mean. Declared by the user, never guessed.
struct PoseSemantics {
  enum class Direction {
    kWorldFromCam,  ///< "T_world_cam": maps points of the child frame to the world; the position is the camera's
    kCamFromWorld,  ///< "T_cam_world": the inverse
  };
  enum class Child {
    kCameraOptical,  ///< "camera_optical": x right, y down, z forward
    kCameraFlu,      ///< "camera_flu": the same camera with x forward, y left, z up
    kBody,           ///< "body": another frame of the robot, see PoseResolver
  };
  Direction direction = Direction::kWorldFromCam;
  Child child = Child::kCameraOptical;
  std::optional<RigidTransform> body_from_cam = std::nullopt;  ///< T_body_cam, if it was given; for kBody
};

/// Maps points of the optical frame to the child frame of the poses. kBody without body_from_cam throws
/// std::logic_error.
RigidTransform ChildFromCamera(const PoseSemantics& semantics);

/// Pose of the optical frame for a transform as received. kBody without body_from_cam throws std::logic_error.
RigidTransform WorldFromCamera(const PoseSemantics& semantics, const RigidTransform& received);

/// Quaternion and position as received. Throws InvalidInputError naming the value unless all are finite and the norm is
/// within 1e-3 of 1.
RigidTransform CheckedTransform(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& position);

/// As in parameters: "T_world_cam", "camera_optical".
const char* Name(PoseSemantics::Direction direction);
const char* Name(PoseSemantics::Child child);

/// "T_world_cam of camera_optical", for messages.
std::string Describe(const PoseSemantics& semantics);

}  // namespace acmp
