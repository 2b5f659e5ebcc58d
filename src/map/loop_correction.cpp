#include "acmp_mapping/map/loop_correction.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>

namespace acmp {
namespace {

/// Index of the pose nearest in time; of several with one stamp the last. The path is not empty.
size_t NearestPose(const std::vector<StampedPose>& path, int64_t stamp_ns) {
  const auto after = std::upper_bound(path.begin(), path.end(), stamp_ns,
                                      [](int64_t stamp, const StampedPose& pose) { return stamp < pose.stamp_ns; });
  if (after == path.begin()) return 0;
  const auto before = std::prev(after);
  const bool later = after != path.end() && after->stamp_ns - stamp_ns < stamp_ns - before->stamp_ns;
  return static_cast<size_t>((later ? after : before) - path.begin());
}

bool SamePose(const RigidTransform& a, const RigidTransform& b, const PoseTolerance& same) {
  // The matrices of two rotations by a small angle from each other differ by sqrt(2) times the angle.
  return (a.translation() - b.translation()).norm() <= same.translation &&
         (a.linear() - b.linear()).norm() <= std::sqrt(2.0) * same.rotation_rad;
}

RigidTransform WorldFromCam(const PathConvention& convention, const RigidTransform& pose) {
  return (convention.maps_world_to_child ? pose.inverse() : pose) * *convention.child_from_cam;
}

/// What the path says of the keyframes it names.
void NameKeyframes(const std::vector<StampedPose>& path, const std::vector<CorrectedPose*>& keyframes,
                   ReposeResult* result) {
  std::vector<bool> used(path.size());
  for (CorrectedPose* keyframe : keyframes) {
    if (!keyframe->path.child_from_cam) {
      ++result->unresolved;
      continue;
    }
    const size_t nearest = NearestPose(path, keyframe->stamp_ns);
    const int64_t gap_ns = std::abs(path[nearest].stamp_ns - keyframe->stamp_ns);
    const int64_t tolerance_ns = keyframe->path.tolerance_ns;
    if (!result->nearest || gap_ns < result->nearest->gap_ns) result->nearest = {gap_ns, tolerance_ns};
    if (gap_ns > tolerance_ns) continue;
    used[nearest] = true;
    ++result->named;
    keyframe->named = keyframe->seeded = true;
    keyframe->correction = WorldFromCam(keyframe->path, path[nearest].pose) * keyframe->received.inverse();
  }
  result->unmatched = static_cast<size_t>(std::count(used.begin(), used.end(), false));
}

}  // namespace

void SortPath(std::vector<StampedPose>* path) {
  std::stable_sort(path->begin(), path->end(),
                   [](const StampedPose& a, const StampedPose& b) { return a.stamp_ns < b.stamp_ns; });
}

ReposeResult Repose(const std::vector<StampedPose>& path, const PoseTolerance& same,
                    const std::vector<CorrectedPose*>& keyframes) {
  ReposeResult result;
  result.unmatched = path.size();
  if (path.empty() || keyframes.empty()) return result;
  NameKeyframes(path, keyframes, &result);

  const auto first = std::find_if(keyframes.begin(), keyframes.end(), [](const auto* k) { return k->seeded; });
  if (first == keyframes.end()) return result;
  RigidTransform correction = (*first)->correction;
  for (size_t i = 0; i < keyframes.size(); ++i) {
    CorrectedPose* keyframe = keyframes[i];
    if (keyframe->named) {
      correction = keyframe->correction;
    } else {
      keyframe->correction = correction;
      keyframe->seeded = true;  // so it goes on telling the next ones when the one it learnt from is evicted
    }
    const RigidTransform corrected = keyframe->correction * keyframe->received;
    if (SamePose(corrected, keyframe->world_from_cam, same)) continue;
    keyframe->world_from_cam = corrected;
    result.moved.push_back(i);
  }
  return result;
}

}  // namespace acmp
