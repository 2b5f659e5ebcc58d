#include "align_views.h"

namespace acmp {

Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count) {
  std::vector<PosePair> poses;
  for (size_t i = 0; i < count; ++i) {
    poses.push_back({ToRigidTransform(from[i]).inverse(), ToRigidTransform(to[i]).inverse()});
  }
  return FitSimilarity(poses);
}

std::vector<ViewPose> Moved(const Similarity& similarity, std::vector<ViewPose> poses) {
  const Eigen::Quaterniond world_from_old(similarity.rigid.linear());
  for (ViewPose& pose : poses) {
    pose = {(pose.rotation * world_from_old.conjugate()).normalized(),
            similarity.rigid * (similarity.scale * pose.centre)};
  }
  return poses;
}

}  // namespace acmp
