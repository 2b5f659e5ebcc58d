#pragma once

#include <functional>
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

/// Pose of a frame in another one, as it was last known; none if it is not known. Must not wait.
using TransformLookup =
    std::function<std::optional<RigidTransform>(const std::string& target_frame, const std::string& source_frame)>;

/// Turns poses as received into poses of the camera's optical frame. With pose_child: body it needs T_body_cam, which
/// comes from the first of these that has it: the parameter, tf, the topic `extrinsic`. Once chosen the source stays,
/// and its latest value counts: some frontends refine it while they run. Not thread-safe.
class PoseResolver {
 public:
  /// @param semantics with the parameter T_body_cam, if it is set
  /// @param extrinsic_inverted the topic has T_cam_body
  /// @param lookup of tf; may be empty
  /// @param path_child whose poses optimized_path has
  PoseResolver(const PoseSemantics& semantics, bool extrinsic_inverted, TransformLookup lookup,
               PoseSemantics::Child path_child = PoseSemantics::Child::kCameraOptical);

  /// What the topic `extrinsic` has brought.
  void SetExtrinsic(const RigidTransform& received);

  /// Looks T_body_cam up where it is not a parameter. Frames may be empty while they are not known.
  void Update(const std::string& body_frame, const std::string& camera_frame);

  /// Whether poses can be resolved.
  bool ready() const { return semantics_.child != PoseSemantics::Child::kBody || semantics_.body_from_cam; }

  /// Why not: what was looked for and what to set.
  std::string DescribeMissing() const;

  /// A sentence that names the source of T_body_cam, once, when it has been chosen.
  std::optional<std::string> TakeNotice();

  /// The semantics with the T_body_cam in use.
  const PoseSemantics& semantics() const { return semantics_; }
  /// The child's frame of optimized_path from the camera's; none where it needs T_body_cam, which is not known.
  std::optional<RigidTransform> PathChildFromCamera() const;

  /// Pose of the optical frame. Precondition: ready().
  RigidTransform WorldFromCamera(const RigidTransform& received) const {
    return acmp::WorldFromCamera(semantics_, received);
  }

 private:
  enum class Source { kNone, kParameter, kTf, kTopic };
  bool needs_extrinsic() const {
    return semantics_.child == PoseSemantics::Child::kBody || path_child_ == PoseSemantics::Child::kBody;
  }
  void Choose(Source source, const std::string& notice);

  PoseSemantics semantics_;
  PoseSemantics::Child path_child_;
  bool extrinsic_inverted_;
  TransformLookup lookup_;
  Source source_ = Source::kNone;
  std::optional<RigidTransform> extrinsic_;
  std::string body_frame_, camera_frame_;
  std::optional<std::string> notice_;
};

}  // namespace acmp
