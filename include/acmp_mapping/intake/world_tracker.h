#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// Tells from the frontend's landmarks whether poses of different images can be used together. A frontend that has just
/// started sends identity poses and empty clouds, then a world whose scale changes until it has been adjusted often
/// enough; one that has lost track, or closed a loop, goes on in another world.
///
/// Landmarks that the last image named must be where they were: seen from the new image, something named now lies in
/// the same direction at the same depth (5 %). The world has changed where that holds for fewer than half of those that
/// can be compared, or where no landmark of one image is in the view of the other. Where there are no landmarks, it
/// has changed when the camera moved by more than the scene's depth, and five times as fast as at any of the last
/// images.
///
/// A start counts as such if it was seen: before the first landmarks came clouds without points and the same pose
/// twice, or the world has just changed. Images then wait until landmarks were adjusted twice and three quarters of
/// them stayed, or until 30 images have come. A mapper that is started beside a running frontend waits for nothing.
class WorldTracker {
 public:
  enum class Verdict {
    kUse,             ///< this image and those that wait
    kWait,            ///< until a later verdict
    kNotInitialised,  ///< the frontend has no landmarks yet: neither this image nor those that wait
    kNotSettled,      ///< the start goes on: not those that wait; this one waits
    kNewWorld,        ///< what comes must not be mixed with what was used; this one waits
  };
  struct Judgement {
    Verdict verdict = Verdict::kUse;
    std::string reason;  ///< a clause with the numbers; empty for kUse and kWait
  };

  /// One posed image.
  struct Sample {
    int64_t stamp_ns = 0;
    RigidTransform world_from_cam = RigidTransform::Identity();
    PinholeCamera camera;
    std::vector<Eigen::Vector3d> landmarks_in_world;
    bool has_empty_cloud = false;  ///< the frontend sent a cloud without a usable point
    double scene_depth = 0;        ///< 0: unknown
  };

  /// Images in the order of their stamps.
  Judgement Add(Sample sample);

  /// What comes has nothing to do with what was.
  void Reset() { *this = WorldTracker(); }

 private:
  Judgement Continue(const Sample& sample);
  Judgement ContinueWithoutLandmarks(const RigidTransform& world_from_cam);
  Judgement ContinueStart(double share_that_stayed, bool were_adjusted);
  Judgement Change(const std::string& reason);
  bool HasJumped(const Sample& sample) const;

  bool is_starting_ = false;
  int adjustments_ = 0;                         ///< since the start, at which most landmarks stayed
  int waiting_ = 0;                             ///< images
  std::optional<RigidTransform> last_without_;  ///< world_from_cam of the last image before the first landmarks
  std::optional<Sample> last_;                  ///< the last one with landmarks
  std::deque<double> speeds_;                   ///< unit of the poses per second, of the last images
  std::optional<int64_t> last_stamp_ns_;
  Eigen::Vector3d last_position_ = Eigen::Vector3d::Zero();
};

}  // namespace acmp
