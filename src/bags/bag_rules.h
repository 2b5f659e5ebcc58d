#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/bags/bag_check.h"
#include "acmp_mapping/common/error.h"

namespace acmp {

/// Collects findings; the arguments are joined to one sentence.
class Findings {
 public:
  template <class... Args>
  void Ok(const Args&... args) {
    list_.push_back({Severity::kOk, Concat(args...)});
  }
  template <class... Args>
  void Warn(const Args&... args) {
    list_.push_back({Severity::kWarning, Concat(args...)});
  }
  template <class... Args>
  void Error(const Args&... args) {
    list_.push_back({Severity::kError, Concat(args...)});
  }
  std::vector<Finding> Take() { return std::move(list_); }

 private:
  std::vector<Finding> list_;
};

/// "12.5 %"
std::string Percent(double share);

/// Seconds from `stamps[i]` to the nearest of `others`, not negative; `others` is sorted and not empty.
std::vector<double> NearestGaps(const std::vector<ros::Time>& stamps, const std::vector<ros::Time>& others);

/// Rules about image and camera_info topics.
void CheckImages(const BagContents& contents, Findings& findings);
void CheckCameraInfo(const BagContents& contents, Findings& findings);
/// Rules about poses alone and against the image stamps.
void CheckPoses(const BagContents& contents, const BagCheckOptions& options, Findings& findings);
/// Rules about clouds alone and against poses and camera.
void CheckClouds(const BagContents& contents, const BagCheckOptions& options, Findings& findings);

}  // namespace acmp
