#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/intake/image_matches.h"
#include "acmp_mapping/intake/pose_semantics.h"

namespace acmp {

/// Pixels of two images that look alike, and the received poses of these.
struct MatchedImages {
  std::vector<Eigen::Vector3d> rays, other_rays;    ///< z = 1; those of one index see the same point
  RigidTransform world_from_cam, other_from_world;  ///< as configured
  double focal_length = 0;                          ///< px
};

/// One way to read the received poses.
struct PoseReading {
  std::string name;                 ///< what to set; empty: as configured
  PoseSemantics semantics;          ///< body_from_cam is set where these are poses of a body
  double share = 0;                 ///< of the matches that lie near their epipolar lines and before both cameras, 0..1
  bool is_declared_by_name = true;  ///< ~pose_is and ~pose_child say it all; false: T_body_cam is another one
};

/// What images say of the poses.
struct ReadingVerdict {
  std::optional<double> share;       ///< of the configured reading, as above; none: images tell too little
  std::vector<PoseReading> tried;    ///< with the configured one, best first; empty as share
  std::vector<PoseReading> fitting;  ///< those that fit clearly better, best first; of several one is right
  std::string text;                  ///< a sentence for the end of a message, "; ..."; empty where nothing fits better

  /// The images have told, and neither this reading nor another one fits.
  bool NothingFits() const { return share && *share < kFittingShare && fitting.empty(); }
  /// Poses of this child fit as well as the best, or images do not tell.
  bool FitsToo(PoseSemantics::Child child) const;
  static constexpr double kFittingShare = 0.5;  ///< of the matches: those of good poses are 0.7 to 0.95
};

/// Which reading of the poses fits the images, among those that a user may have meant. Where none does, rotations
/// between the frame of the poses and the camera are tried, with the configured place of the camera in the body and
/// without one.
ReadingVerdict JudgeReadings(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs);

/// Keeps the last keyframes' images, so that JudgeReadings can be asked when maps say that poses are wrong.
/// Thread-safe.
class ReadingCheck {
 public:
  explicit ReadingCheck(size_t kept_images = 12) : kept_images_(kept_images) {}

  /// A keyframe as received.
  void Add(const Frame& frame);
  void Clear();
  /// JudgeReadings of the last keyframes. That takes some tenths of a second, so once for a number of them; keyframes
  /// come in meanwhile.
  ReadingVerdict Judge(const PoseSemantics& configured);
  /// The last one; says nothing before the first.
  ReadingVerdict verdict() const;

 private:
  static std::vector<MatchedImages> Match(const std::vector<SmallImage>& images);

  const size_t kept_images_;
  mutable std::mutex mutex_;
  std::deque<SmallImage> images_;
  uint64_t added_ = 0, next_ = 0;  ///< images; and when it is worth to look again
  uint64_t cleared_ = 0;           ///< times
  ReadingVerdict verdict_;
};

}  // namespace acmp
