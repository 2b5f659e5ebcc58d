#include "acmp_mapping/geometry/similarity.h"

#include <algorithm>

namespace acmp {
namespace {

/// Of poses [begin, end), each with its weight.
template <class Weight>
Similarity Fit(const std::vector<PosePair>& poses, size_t begin, size_t end, const Weight& weight) {
  Eigen::Vector4d turn = Eigen::Vector4d::Zero();  // sum of unit quaternions of one sign: their mean, normalised
  Eigen::Vector3d from_mean = Eigen::Vector3d::Zero(), to_mean = from_mean;
  double sum = 0;
  for (size_t i = begin; i < end; ++i) {
    const PosePair& pose = poses[i];
    const Eigen::Vector4d q = Eigen::Quaterniond(pose.to.linear() * pose.from.linear().transpose()).coeffs();
    const double w = weight(i);
    turn += (q.dot(turn) < 0 ? -w : w) * q;
    from_mean += w * pose.from.translation();
    to_mean += w * pose.to.translation();
    sum += w;
  }
  from_mean /= sum, to_mean /= sum;
  Similarity result;
  const Eigen::Matrix3d rotation = Eigen::Quaterniond(turn).normalized().toRotationMatrix();
  double products = 0, squares = 0;
  for (size_t i = begin; i < end; ++i) {
    const Eigen::Vector3d moved = rotation * (poses[i].from.translation() - from_mean);
    products += weight(i) * moved.dot(poses[i].to.translation() - to_mean);
    squares += weight(i) * moved.squaredNorm();
  }
  if (products > 0 && squares > 0) result.scale = products / squares;
  result.rigid.linear() = rotation;
  result.rigid.translation() = to_mean - rotation * (result.scale * from_mean);
  return result;
}

}  // namespace

RigidTransform Similarity::Moved(const RigidTransform& world_from_cam) const {
  RigidTransform scaled = world_from_cam;
  scaled.translation() *= scale;
  return rigid * scaled;
}

Similarity FitSimilarity(const std::vector<PosePair>& poses) {
  if (poses.size() < kMinForSimilarity) return {};
  return Fit(poses, 0, poses.size(), [](size_t) { return 1.0; });
}

std::vector<Similarity> AlignAlong(const std::vector<PosePair>& poses) {
  std::vector<Similarity> aligned(poses.size());
  if (poses.size() < kMinForSimilarity) return aligned;
  for (size_t i = 0; i < poses.size(); ++i) {
    const auto weight = [i](size_t j) { return static_cast<double>(kAlignmentReach - (i < j ? j - i : i - j)); };
    const size_t begin = i - std::min(i, kAlignmentReach - 1);
    aligned[i] = Fit(poses, begin, std::min(i + kAlignmentReach, poses.size()), weight);
  }
  return aligned;
}

}  // namespace acmp
