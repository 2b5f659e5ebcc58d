#include "acmp_mapping/intake/pose_semantics.h"

#include <cmath>
#include <stdexcept>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// Maps points of the optical frame (x right, y down, z forward) to the same camera's FLU frame (x forward, y left, z
/// up).
RigidTransform FluFromOptical() {
  RigidTransform flu_from_optical = RigidTransform::Identity();
  flu_from_optical.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return flu_from_optical;
}

}  // namespace

RigidTransform ChildFromCamera(const PoseSemantics& semantics) {
  switch (semantics.child) {
    case PoseSemantics::Child::kCameraOptical:
      break;
    case PoseSemantics::Child::kCameraFlu:
      return FluFromOptical();
    case PoseSemantics::Child::kBody:
      if (!semantics.body_from_cam) throw std::logic_error("T_body_cam is not known");
      return *semantics.body_from_cam;
  }
  return RigidTransform::Identity();
}

RigidTransform WorldFromCamera(const PoseSemantics& semantics, const RigidTransform& received) {
  RigidTransform world_from_child =
      semantics.direction == PoseSemantics::Direction::kWorldFromCam ? received : received.inverse();
  if (semantics.child == PoseSemantics::Child::kCameraOptical) return world_from_child;
  return world_from_child * ChildFromCamera(semantics);
}

RigidTransform CheckedTransform(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& position) {
  constexpr double kMaxNormError = 1e-3;
  const auto text = [&] {
    return Concat("position (", position.x(), ", ", position.y(), ", ", position.z(), "), quaternion x y z w (",
                  rotation.x(), ", ", rotation.y(), ", ", rotation.z(), ", ", rotation.w(), ")");
  };
  if (!position.allFinite() || !rotation.coeffs().allFinite()) throw InvalidInputError(Concat(text(), ": not finite"));
  const double norm = rotation.norm();
  if (!(std::abs(norm - 1) <= kMaxNormError)) {
    throw InvalidInputError(Concat(text(), ": the quaternion's norm is ", norm, ", must be 1 within ", kMaxNormError));
  }
  RigidTransform transform = RigidTransform::Identity();
  transform.linear() = rotation.normalized().toRotationMatrix();
  transform.translation() = position;
  return transform;
}

const char* Name(PoseSemantics::Direction direction) {
  return direction == PoseSemantics::Direction::kWorldFromCam ? "T_world_cam" : "T_cam_world";
}

const char* Name(PoseSemantics::Child child) {
  switch (child) {
    case PoseSemantics::Child::kCameraOptical:
      return "camera_optical";
    case PoseSemantics::Child::kCameraFlu:
      return "camera_flu";
    case PoseSemantics::Child::kBody:
      return "body";
  }
  return "?";
}

std::string Describe(const PoseSemantics& semantics) {
  return Concat(Name(semantics.direction), " of ", Name(semantics.child));
}

}  // namespace acmp
