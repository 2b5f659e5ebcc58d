#include "acmp_mapping/geometry/similarity.h"

#include <algorithm>
#include <map>
#include <utility>

namespace acmp {
namespace {

/// Baselines between so many poses tell the scale: noise of single poses hardly counts in them, and what drifts over
/// the whole trajectory not at all. Maps are made over such baselines.
constexpr size_t kBaseline = 4;

/// Some poses, by their positions, and how much each counts.
struct AlongWeights {
  size_t begin, end, middle, reach;
  double operator()(size_t i) const { return static_cast<double>(reach - (i < middle ? middle - i : i - middle)); }
};
AlongWeights WeightsAround(size_t middle, size_t reach, size_t count) {
  return {middle - std::min(middle, reach - 1), std::min(middle + reach, count), middle, reach};
}

template <class Weight>
double BaselineScale(const std::vector<PosePair>& poses, size_t begin, size_t end, const Weight& weight) {
  double products = 0, squares = 0;
  const size_t gap = std::min(kBaseline, end - begin - 1);
  for (size_t i = begin, j = begin + gap; j < end; ++i, ++j) {
    // In the first pose's axes: whoever drifts turns, too.
    const auto baseline = [&](const RigidTransform& a, const RigidTransform& b) -> Eigen::Vector3d {
      return a.linear().transpose() * (b.translation() - a.translation());
    };
    const Eigen::Vector3d from = baseline(poses[i].from, poses[j].from), to = baseline(poses[i].to, poses[j].to);
    const double w = std::min(weight(i), weight(j));
    products += w * from.dot(to);
    squares += w * from.squaredNorm();
  }
  return products > 0 && squares > 0 ? products / squares : 1;
}

/// Mean rotation and mean place of poses [begin, end), each with its weight.
template <class Weight>
Similarity PlaceWeighted(const std::vector<PosePair>& poses, size_t begin, size_t end, const Weight& weight,
                         double scale) {
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
  Similarity result;
  result.scale = scale;
  result.rigid.linear() = Eigen::Quaterniond(turn).normalized().toRotationMatrix();
  result.rigid.translation() = (to_mean - result.rigid.linear() * (scale * from_mean)) / sum;
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
  const auto same = [](size_t) { return 1.0; };
  return PlaceWeighted(poses, 0, poses.size(), same, BaselineScale(poses, 0, poses.size(), same));
}

std::vector<Similarity> AlignAlong(const std::vector<PosePair>& poses, std::optional<double> scale) {
  std::vector<Similarity> aligned(poses.size());
  if (poses.size() < kMinForSimilarity) return aligned;
  for (size_t i = 0; i < poses.size(); ++i) {
    const AlongWeights wide = WeightsAround(i, kScaleReach, poses.size()),
                       near = WeightsAround(i, kAlignmentReach, poses.size());
    aligned[i] = PlaceWeighted(poses, near.begin, near.end, near,
                               scale ? *scale : BaselineScale(poses, wide.begin, wide.end, wide));
  }
  return aligned;
}

std::vector<std::optional<Similarity>> PlaceAlong(const std::vector<TrajectoryKeyframe>& keyframes) {
  struct World {
    int64_t capture;                                 // the last one
    std::vector<PosePair> poses;                     // of each capture, by its first keyframe
    std::vector<std::pair<size_t, size_t>> members;  // keyframe, capture
  };
  std::map<uint64_t, World> worlds;
  for (size_t i = 0; i < keyframes.size(); ++i) {
    const auto& [capture, poses] = keyframes[i];
    World& world = worlds[poses.refined.world];
    if (world.poses.empty() || world.capture != capture) {
      world.capture = capture;
      world.poses.push_back({poses.refined.world_from_cam, poses.received});
    }
    world.members.emplace_back(i, world.poses.size() - 1);
  }
  std::vector<std::optional<Similarity>> placed(keyframes.size());
  for (const auto& [number, world] : worlds) {
    if (world.poses.size() < kMinForSimilarity) continue;
    const std::vector<Similarity> aligned = AlignAlong(world.poses);
    for (const auto& [i, capture] : world.members) {
      const RefinedCamera& refined = keyframes[i].poses.refined;
      placed[i] = {aligned[capture].Moved(refined.world_from_cam), aligned[capture].scale / refined.scale};
    }
  }
  return placed;
}

}  // namespace acmp
