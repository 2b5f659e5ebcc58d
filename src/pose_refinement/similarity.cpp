#include "similarity.h"

#include "rotation_vector.h"

namespace acmp {

Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count) {
  if (count < kMinForSimilarity) return {};
  const double share = 1.0 / static_cast<double>(count);
  Eigen::Vector3d turn = Eigen::Vector3d::Zero(), from_mean = turn, to_mean = turn;
  for (size_t i = 0; i < count; ++i) {
    turn += share * RotationVector(to[i].rotation.conjugate() * from[i].rotation);
    from_mean += share * from[i].centre;
    to_mean += share * to[i].centre;
  }
  Similarity result;
  result.rotation = RotationAbout(turn);
  double products = 0, squares = 0;
  for (size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d moved = result.rotation * (from[i].centre - from_mean);
    products += moved.dot(to[i].centre - to_mean), squares += moved.squaredNorm();
  }
  if (products > 0 && squares > 0) result.scale = products / squares;
  result.translation = to_mean - result.scale * (result.rotation * from_mean);
  return result;
}

std::vector<ViewPose> Moved(const Similarity& similarity, std::vector<ViewPose> poses) {
  for (ViewPose& pose : poses) pose = similarity * pose;
  return poses;
}

}  // namespace acmp
