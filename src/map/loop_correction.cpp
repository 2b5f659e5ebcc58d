#include "acmp_mapping/map/loop_correction.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <map>
#include <vector>

#include "acmp_mapping/common/median.h"

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

constexpr size_t kNeighbours = 5;  ///< steps on each side that tell a keyframe's scale
constexpr double kAgreeing = 0.1;  ///< relative deviation from the median
constexpr double kLeastChange = 0.02;

bool SamePose(const RigidTransform& a, const RigidTransform& b, const PoseTolerance& same) {
  // The matrices of two rotations by a small angle from each other differ by sqrt(2) times the angle.
  return (a.translation() - b.translation()).norm() <= same.translation &&
         (a.linear() - b.linear()).norm() <= std::sqrt(2.0) * same.rotation_rad;
}

RigidTransform WorldFromCam(const PathConvention& convention, const RigidTransform& pose) {
  return (convention.maps_world_to_child ? pose.inverse() : pose) * *convention.child_from_cam;
}

/// What the ratios of distances after and before say about the scale; 1 if they tell nothing.
double ScaleOf(const std::vector<double>& ratios) {
  if (ratios.size() < kNeighbours) return 1;
  const double median = Median(ratios);
  const auto agreeing = static_cast<size_t>(std::count_if(
      ratios.begin(), ratios.end(), [&](double ratio) { return std::abs(ratio - median) <= kAgreeing * median; }));
  return 4 * agreeing >= 3 * ratios.size() && std::abs(median - 1) > kLeastChange ? median : 1;
}

/// A keyframe that the path names, and what that makes of its pose.
struct NamedKeyframe {
  CorrectedPose* keyframe;
  RigidTransform world_from_cam;
};

/// Keyframes of one trajectory that were taken together.
using NamedCapture = std::vector<NamedKeyframe>;

/// Corrections of the captures of one trajectory, given in its order.
void CorrectNamed(const std::vector<NamedCapture>& captures) {
  std::vector<double> ratios;  // of the step from each to the next; negative: none
  for (size_t i = 0; i + 1 < captures.size(); ++i) {
    const NamedKeyframe &here = captures[i].front(), &next = captures[i + 1].front();
    const double before = (next.keyframe->received.translation() - here.keyframe->received.translation()).norm();
    const double after = (next.world_from_cam.translation() - here.world_from_cam.translation()).norm();
    ratios.push_back(before > 0 ? after / before : -1);
  }
  for (size_t i = 0; i < captures.size(); ++i) {
    std::vector<double> nearby;
    for (size_t step = i - std::min(i, kNeighbours); step < std::min(i + kNeighbours, ratios.size()); ++step) {
      if (ratios[step] >= 0) nearby.push_back(ratios[step]);
    }
    const double scale = ScaleOf(nearby);
    for (const NamedKeyframe& named : captures[i]) {
      RigidTransform scaled = named.keyframe->received;
      scaled.translation() *= scale;
      named.keyframe->correction = {named.world_from_cam * scaled.inverse(), scale};
    }
  }
}

/// Whether a keyframe's points would be near enough; counts it where not. False for NaN, too.
bool IsWithin(const Surroundings& allowed, const CorrectedPose& keyframe, const RigidTransform& world_from_cam,
              double scale, const StampedPose& cause, ReposeResult* result) {
  const double distance = (world_from_cam.translation() - allowed.origin).norm();
  if (distance + scale * keyframe.reach <= allowed.max_distance) return true;
  ++result->too_far;
  if (!result->first_too_far) result->first_too_far = {cause.stamp_ns, cause.pose.translation(), allowed};
  return false;
}

/// What the path says of the keyframes it names.
void NameKeyframes(const std::vector<StampedPose>& path, const Surroundings& allowed,
                   const std::vector<CorrectedPose*>& keyframes, ReposeResult* result) {
  std::vector<bool> used(path.size());
  std::map<size_t, std::vector<NamedCapture>> named;  // of each trajectory
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
    const RigidTransform world_from_cam = WorldFromCam(keyframe->path, path[nearest].pose);
    if (!IsWithin(allowed, *keyframe, world_from_cam, 1, path[nearest], result)) continue;
    ++result->named;
    keyframe->named = keyframe->seeded = true;
    std::vector<NamedCapture>& captures = named[keyframe->trajectory];
    const bool begins = captures.empty() || captures.back().front().keyframe->stamp_ns != keyframe->stamp_ns;
    if (begins) captures.emplace_back();
    captures.back().push_back({keyframe, world_from_cam});
  }
  for (const auto& [trajectory, captures] : named) CorrectNamed(captures);
  result->unmatched = static_cast<size_t>(std::count(used.begin(), used.end(), false));
}

}  // namespace

ReposeResult Repose(const std::vector<StampedPose>& path, const PoseTolerance& same, const Surroundings& allowed,
                    const std::vector<CorrectedPose*>& keyframes) {
  ReposeResult result;
  result.unmatched = path.size();
  if (path.empty() || keyframes.empty()) return result;
  NameKeyframes(path, allowed, keyframes, &result);

  const auto first = std::find_if(keyframes.begin(), keyframes.end(), [](const auto* k) { return k->seeded; });
  if (first == keyframes.end()) return result;
  Similarity correction = (*first)->correction;
  for (size_t i = 0; i < keyframes.size(); ++i) {
    CorrectedPose* keyframe = keyframes[i];
    if (keyframe->named) {
      correction = keyframe->correction;
    } else {
      keyframe->correction = correction;
      keyframe->seeded = true;  // so it goes on telling the next ones when the one it learnt from is evicted
    }
    const RigidTransform corrected = keyframe->correction.Moved(keyframe->received);
    const bool same_scale = std::abs(keyframe->correction.scale - keyframe->scale) <= same.scale * keyframe->scale;
    if (same_scale && SamePose(corrected, keyframe->world_from_cam, same)) continue;
    const StampedPose moved = {keyframe->stamp_ns, corrected};
    if (!IsWithin(allowed, *keyframe, corrected, keyframe->correction.scale, moved, &result)) continue;
    keyframe->world_from_cam = corrected;
    keyframe->scale = keyframe->correction.scale;
    result.moved.push_back(i);
  }
  return result;
}

}  // namespace acmp
