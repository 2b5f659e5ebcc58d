#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

/// Pixels of two images that look alike, and the received poses of these.
struct MatchedImages {
  std::vector<Eigen::Vector3d> rays, other_rays;    ///< z = 1; those of one index see the same point
  RigidTransform world_from_cam, other_from_world;  ///< as configured
  double focal_length = 0;                          ///< px
};

/// Which reading of the poses fits the images: the share of the matches near their epipolar lines is compared among
/// those that a user may have meant. Where none fits, any rotation between the frame of the poses and the camera is
/// tried: from pairs of turns, A X = X B (Tsai and Lenz, 1989), then refined. Empty where the configured reading fits,
/// images tell too little, or nothing fits; begins with "; ". Where several fit alike it names them and says so.
std::string DescribeReadings(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs);

/// Keeps the last keyframes' images, so that DescribeReadings can be asked when maps say that poses are wrong.
/// Thread-safe.
class ReadingCheck {
 public:
  /// A keyframe as received.
  void Add(const Frame& frame);
  /// DescribeReadings of the last keyframes. That takes some tenths of a second, so once for a number of them.
  std::string Describe(const PoseSemantics& configured);

 private:
  struct SmallImage {
    cv::Mat gray;  ///< 8 bits
    PinholeCamera camera;
    RigidTransform world_from_cam;
  };
  std::mutex mutex_;
  std::deque<SmallImage> images_;
  uint64_t added_ = 0, next_ = 0;  ///< images; and when it is worth to look again
  std::string text_;
};

}  // namespace acmp
