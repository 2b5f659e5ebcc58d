#include <tbb/parallel_for.h>

#include <algorithm>
#include <deque>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pose_refinement/pose_refiner.h"
#include "matching.h"

namespace acmp {
namespace {

constexpr int kCorners = 150;

constexpr size_t kMostOthers = 8;

/// Points of the corners that are found in the others; none where most of them hardly move.
/// @param anchor of the frame
std::vector<Eigen::Vector3d> FindPoints(const Frame& frame, const PosedView& anchor,
                                        const std::vector<Eigen::Vector2d>& corners,
                                        const std::vector<PosedView>& others) {
  double baseline = 0;
  for (const PosedView& other : others) {
    baseline = std::max(baseline, (other.pose.centre - anchor.pose.centre).norm());
  }
  // From where the farthest view sees a pixel moved by half of the focal length to where by one pixel.
  const DepthRange search = {static_cast<float>(2 * baseline), static_cast<float>(frame.camera.fx * baseline)};
  if (!(search.min > 0 && search.min < search.max)) return {};
  std::vector<double> inverse_depths(corners.size());  // 0: not found
  tbb::parallel_for(size_t{0}, corners.size(),
                    [&](size_t i) { inverse_depths[i] = SearchInverseDepth(anchor, corners[i], search, others); });
  std::vector<Eigen::Vector3d> points;
  size_t moved = 0;
  for (size_t i = 0; i < corners.size(); ++i) {
    if (!(inverse_depths[i] > 0)) continue;
    constexpr double kClearPixels = 4;
    moved += inverse_depths[i] * search.max >= kClearPixels ? 1 : 0;
    points.push_back(frame.cam_from_world.inverse() * frame.camera.Unproject(corners[i], 1 / inverse_depths[i]));
  }
  if (2 * moved < points.size()) points.clear();
  return points;
}

}  // namespace

std::optional<DepthRange> DepthRangeFromMatches(const Frame& frame, const std::vector<FramePtr>& others) {
  const auto make_view = [](const Frame& f) { return MakeView(Concat("keyframe ", f.id), f.camera, f.gray, f.mask); };
  const View view = make_view(frame);
  const PosedView anchor = {&view, ToViewPose(frame.cam_from_world)};
  const std::vector<Eigen::Vector2d> corners = PickCorners(view, CornerResponse(view), kCorners);
  std::deque<View> views;
  std::vector<PosedView> posed;
  for (const FramePtr& other : others) {
    views.push_back(make_view(*other));
    posed.push_back({&views.back(), ToViewPose(other->cam_from_world)});
    const size_t count = views.size();
    const bool is_power_of_two = (count & (count - 1)) == 0;
    if (!is_power_of_two && count < std::min(others.size(), kMostOthers)) continue;
    const std::optional<DepthRange> range =
        DepthRangeFromLandmarks(FindPoints(frame, anchor, corners, posed), frame.camera, frame.cam_from_world);
    if (range || count >= kMostOthers) return range;
  }
  return std::nullopt;
}

}  // namespace acmp
