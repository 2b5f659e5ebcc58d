#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/intake/image_matches.h"

namespace acmp {

/// Pixels of the images of two cameras that look alike, and the depths of some, known by other means than this pair.
struct RigMatches {
  std::vector<Eigen::Vector3d> rays, other_rays;  ///< z = 1; of the camera, of the source camera
  std::vector<std::optional<double>> depths;      ///< of the first ray; unit of the poses
  double focal_length = 0;                        ///< px, of the source camera
  RigidTransform source_from_cam;                 ///< as declared
};

/// What matches say of where a source camera lies: empty where they fit, or tell too little; else a sentence with what
/// fits: the other side (the sign of P[3], T_cam_source inverted, cameras swapped), another rotation (images that are
/// not rectified, a calibration of another rig), another length (millimetres, poses that are not in metres), or
/// nothing.
std::string JudgeRig(const RigMatches& matches);

/// Keeps some images of a camera and of one that is fixed to it, so that JudgeRig can be asked. Thread-safe.
class RigCheck {
 public:
  /// Two images of one instant; the keyframe with its landmarks.
  void Add(const Frame& keyframe, const Frame& companion);
  void Clear();
  /// JudgeRig of the images that have come, again when there are twice as many. That takes some tenths of a second.
  /// @param at_end no more may come: of any that are new
  std::string Judge(bool at_end = false);

 private:
  struct Pair {
    SmallImage image, other;
    std::vector<Eigen::Vector3d> landmarks_in_world;
  };
  using Pairs = std::deque<std::shared_ptr<const Pair>>;
  static RigMatches Match(const Pairs& pairs);

  std::mutex mutex_;
  Pairs pairs_;
  uint64_t added_ = 0, judged_ = 0;  ///< pairs; and as many when they were judged last
  uint64_t cleared_ = 0;             ///< how often
  std::string verdict_;
};

}  // namespace acmp
