#pragma once

#include <cstddef>
#include <vector>

#include "view.h"

namespace acmp {

/// x -> scale rotation x + translation.
struct Similarity {
  double scale = 1;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  ViewPose operator*(const ViewPose& pose) const {
    return {(pose.rotation * rotation.conjugate()).normalized(), scale * (rotation * pose.centre) + translation};
  }
};

/// Fewer poses do not tell scale and place of a trajectory.
constexpr size_t kMinForSimilarity = 4;

/// The similarity that takes the first `count` poses `from` to `to`: mean of the rotations, least squares of the
/// centres along them. A trajectory may be straight, so that its centres alone do not tell the rotation. The identity
/// for fewer than kMinForSimilarity poses.
Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count);

std::vector<ViewPose> Moved(const Similarity& similarity, std::vector<ViewPose> poses);

}  // namespace acmp
