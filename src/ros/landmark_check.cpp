#include "acmp_mapping/ros/landmark_check.h"

#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {

std::optional<std::string> LandmarkCheck::Add(const Frame& frame) {
  if (keyframes_ >= kKeyframes || frame.landmarks_in_world.empty()) return std::nullopt;
  for (const Eigen::Vector3d& landmark : frame.landmarks_in_world) {
    in_front_ += (frame.cam_from_world * landmark).z() > 0;
  }
  landmarks_ += frame.landmarks_in_world.size();
  if (++keyframes_ < kKeyframes || *share_in_front() >= 0.5) return std::nullopt;
  return Concat("only ", std::lround(100 * *share_in_front()), " % of the sparse points of the first ", kKeyframes,
                " keyframes lie in front of the camera: ~pose_is, ~pose_child (now ", Describe(semantics_),
                ") or ~sparse_frame are probably wrong for this frontend");
}

std::optional<double> LandmarkCheck::share_in_front() const {
  if (landmarks_ == 0) return std::nullopt;
  return static_cast<double>(in_front_) / static_cast<double>(landmarks_);
}

}  // namespace acmp
