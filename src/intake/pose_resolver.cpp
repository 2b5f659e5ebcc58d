#include "acmp_mapping/intake/pose_resolver.h"

#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::string DescribePosition(const RigidTransform& body_from_cam) {
  const Eigen::Vector3d& p = body_from_cam.translation();
  return Concat("; the camera is at (", p.x(), ", ", p.y(), ", ", p.z(), ") in the body");
}

}  // namespace

PoseResolver::PoseResolver(const PoseSemantics& semantics, bool extrinsic_inverted, TransformLookup lookup)
    : semantics_(semantics), extrinsic_inverted_(extrinsic_inverted), lookup_(std::move(lookup)) {
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

std::optional<std::string> PoseResolver::TakeNotice() { return std::exchange(notice_, std::nullopt); }

}  // namespace acmp
