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

RigidTransform WorldFromCapture(const PathConvention& convention, const RigidTransform& pose) {
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

/// A capture that the path names, and what that makes of its pose.
struct NamedCapture {
  CorrectedPose* capture;
  RigidTransform world_from_capture;
};

/// Corrections of the captures of one trajectory, given in its order.
void CorrectNamed(const std::vector<NamedCapture>& captures) {
  std::vector<double> ratios;  // of the step from each to the next; negative: none
  for (size_t i = 0; i + 1 < captures.size(); ++i) {
    const NamedCapture &here = captures[i], &next = captures[i + 1];
    const double before = (next.capture->received.translation() - here.capture->received.translation()).norm();
    const double after = (next.world_from_capture.translation() - here.world_from_capture.translation()).norm();
    ratios.push_back(before > 0 ? after / before : -1);
  }
  for (size_t i = 0; i < captures.size(); ++i) {
    std::vector<double> nearby;
    for (size_t step = i - std::min(i, kNeighbours); step < std::min(i + kNeighbours, ratios.size()); ++step) {
      if (ratios[step] >= 0) nearby.push_back(ratios[step]);
    }
    const double scale = ScaleOf(nearby);
    RigidTransform scaled = captures[i].capture->received;
    scaled.translation() *= scale;
    captures[i].capture->correction = {captures[i].world_from_capture * scaled.inverse(), scale};
  }
}

/// Whether a capture's points would be near enough; counts it where not. False for NaN, too.
bool IsWithin(const Surroundings& allowed, const CorrectedPose& capture, const RigidTransform& world_from_capture,
              double scale, const StampedPose& cause, ReposeResult* result) {
  const double distance = (world_from_capture.translation() - allowed.origin).norm();
  if (distance + scale * capture.reach <= allowed.max_distance) return true;
  ++result->too_far;
  if (!result->first_too_far) result->first_too_far = {cause.stamp_ns, cause.pose.translation(), allowed};
  return false;
}

/// What the path says of the captures it names.
void NameCaptures(const std::vector<StampedPose>& path, const Surroundings& allowed,
                  const std::vector<CorrectedPose*>& captures, ReposeResult* result) {
  std::vector<bool> used(path.size());
  std::map<size_t, std::vector<NamedCapture>> named;  // of each trajectory
  for (CorrectedPose* capture : captures) {
    if (!capture->path.child_from_cam) {
      ++result->unresolved;
      continue;
    }
    const size_t nearest = NearestPose(path, capture->stamp_ns);
    const int64_t gap_ns = std::abs(path[nearest].stamp_ns - capture->stamp_ns);
    const int64_t tolerance_ns = capture->path.tolerance_ns;
    if (!result->nearest || gap_ns < result->nearest->gap_ns) result->nearest = {gap_ns, tolerance_ns};
    if (gap_ns > tolerance_ns) continue;
    used[nearest] = true;
    const RigidTransform world_from_capture = WorldFromCapture(capture->path, path[nearest].pose);
    if (!IsWithin(allowed, *capture, world_from_capture, 1, path[nearest], result)) continue;
    ++result->named;
    capture->named = capture->seeded = true;
    named[capture->trajectory].push_back({capture, world_from_capture});
  }
  for (const auto& [trajectory, captures] : named) CorrectNamed(captures);
  result->unmatched = static_cast<size_t>(std::count(used.begin(), used.end(), false));
}

}  // namespace

ReposeResult Repose(const std::vector<StampedPose>& path, const PoseTolerance& same, const Surroundings& allowed,
                    const std::vector<CorrectedPose*>& captures) {
  ReposeResult result;
  result.unmatched = path.size();
  if (path.empty() || captures.empty()) return result;
  NameCaptures(path, allowed, captures, &result);

  const auto first = std::find_if(captures.begin(), captures.end(), [](const auto* k) { return k->seeded; });
  if (first == captures.end()) return result;
  Similarity correction = (*first)->correction;
  for (size_t i = 0; i < captures.size(); ++i) {
    CorrectedPose* capture = captures[i];
    if (capture->named) {
      correction = capture->correction;
    } else {
      capture->correction = correction;
      capture->seeded = true;  // so it goes on telling the next ones when the one it learnt from is evicted
    }
    const RigidTransform corrected = capture->correction.Moved(capture->received);
    const bool same_scale = std::abs(capture->correction.scale - capture->scale) <= same.scale * capture->scale;
    if (same_scale && SamePose(corrected, capture->world_from_capture, same)) continue;
    const StampedPose moved = {capture->stamp_ns, corrected};
    if (!IsWithin(allowed, *capture, corrected, capture->correction.scale, moved, &result)) continue;
    capture->world_from_capture = corrected;
    capture->scale = capture->correction.scale;
    result.moved.push_back(i);
  }
  return result;
}

}  // namespace acmp
