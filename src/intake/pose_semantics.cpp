#include "acmp_mapping/intake/pose_semantics.h"

#include <cmath>
#include <stdexcept>
#include <utility>

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

std::string DescribePosition(const RigidTransform& body_from_cam) {
  const Eigen::Vector3d& p = body_from_cam.translation();
  return Concat("; the camera is at (", p.x(), ", ", p.y(), ", ", p.z(), ") in the body");
}

}  // namespace

RigidTransform ChildFromCamera(const PoseSemantics& semantics) {
  if (semantics.child == PoseSemantics::Child::kCameraOptical) return RigidTransform::Identity();
  if (semantics.child == PoseSemantics::Child::kCameraFlu) return FluFromOptical();
  if (!semantics.body_from_cam) throw std::logic_error("T_body_cam is not known");
  return *semantics.body_from_cam;
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
  constexpr const char* kNames[] = {"camera_optical", "camera_flu", "body"};
  return kNames[static_cast<size_t>(child)];
}

std::string Describe(const PoseSemantics& semantics) {
  return Concat(Name(semantics.direction), " of ", Name(semantics.child));
}

PoseResolver::PoseResolver(const PoseSemantics& semantics, bool extrinsic_inverted, TransformLookup lookup,
                           PoseSemantics::Child path_child)
    : semantics_(semantics),
      path_child_(path_child),
      extrinsic_inverted_(extrinsic_inverted),
      lookup_(std::move(lookup)) {
  if (!semantics_.body_from_cam) return;
  Choose(Source::kParameter, "parameter ~T_body_cam" + DescribePosition(*semantics_.body_from_cam));
}

void PoseResolver::SetExtrinsic(const RigidTransform& received) {
  extrinsic_ = extrinsic_inverted_ ? received.inverse() : received;
  if (source_ == Source::kTopic) semantics_.body_from_cam = extrinsic_;
}

void PoseResolver::Update(const std::string& body_frame, const std::string& camera_frame) {
  if (source_ == Source::kParameter || (body_frame == camera_frame && !needs_extrinsic())) return;
  body_frame_ = body_frame;
  camera_frame_ = camera_frame;
  if (source_ != Source::kTopic && lookup_ && !body_frame.empty() && !camera_frame.empty()) {
    if (const auto body_from_cam = lookup_(body_frame, camera_frame)) {
      semantics_.body_from_cam = body_from_cam;
      if (source_ != Source::kTf) {
        Choose(Source::kTf, Concat("tf, \"", body_frame, "\" to \"", camera_frame, "\"") +
                                DescribePosition(*semantics_.body_from_cam));
      }
    }
  }
  if (source_ != Source::kNone || !extrinsic_) return;
  semantics_.body_from_cam = extrinsic_;
  Choose(Source::kTopic, Concat("topic extrinsic", extrinsic_inverted_ ? ", inverted" : "") +
                             DescribePosition(*semantics_.body_from_cam));
}

void PoseResolver::Choose(Source source, const std::string& notice) {
  source_ = source;
  if (needs_extrinsic()) notice_ = "T_body_cam is taken from " + notice;
}

std::string PoseResolver::DescribeMissing() const {
  const auto named = [](const std::string& frame, const char* parameter) {
    return frame.empty() ? Concat("(no name: set ~", parameter, ")") : Concat('"', frame, '"');
  };
  return Concat("T_body_cam is not known: ~T_body_cam is not set, tf has no transform from ",
                named(body_frame_, "body_frame"), " to ", named(camera_frame_, "camera_frame"),
                ", and nothing came on the topic extrinsic");
}

std::optional<RigidTransform> PoseResolver::PathChildFromCamera() const {
  if (path_child_ == PoseSemantics::Child::kBody) return semantics_.body_from_cam;
  return ChildFromCamera({semantics_.direction, path_child_});
}

std::optional<std::string> PoseResolver::TakeNotice() { return std::exchange(notice_, std::nullopt); }

}  // namespace acmp
