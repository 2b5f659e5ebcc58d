#include "acmp_mapping/pose_refinement/matched_depth_range.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <deque>

#include "corner_detection.h"
#include "landmark_matching.h"

namespace acmp {
namespace {

constexpr int kCorners = 150;

View MakeView(const Frame& frame) {
  return {frame.camera, GrayPyramid(frame.gray.View()), MakeMaskDistance(frame.mask)};
}

}  // namespace

std::optional<DepthRange> DepthRangeFromMatches(const Frame& frame, const std::vector<FramePtr>& others,
                                                const DepthRangeOptions& options) {
  const View view = MakeView(frame);
  const PosedView anchor = {0, &view, ToViewPose(frame.cam_from_world)};
  std::deque<View> views;
  std::vector<PosedView> posed;
  double baseline = 0;
  for (const FramePtr& other : others) {
    views.push_back(MakeView(*other));
    posed.push_back({static_cast<int>(views.size()), &views.back(), ToViewPose(other->cam_from_world)});
    baseline = std::max(baseline, (posed.back().pose.centre - anchor.pose.centre).norm());
  }
  // From where the farthest frame sees a pixel moved by half of the focal length to where by one pixel.
  const DepthRange search = {static_cast<float>(2 * baseline), static_cast<float>(frame.camera.fx * baseline)};
  if (!(search.min > 0 && search.min < search.max)) return std::nullopt;
  const std::vector<Eigen::Vector2d> corners =
      PickCorners(view, CornerResponse(view.pyramid.level(0)), {}, CornersFor(frame.camera, kCorners));
  std::vector<double> inverse_depths(corners.size());  // 0: not found
  tbb::parallel_for(size_t{0}, corners.size(),
                    [&](size_t i) { inverse_depths[i] = SearchInverseDepth(anchor, corners[i], search, posed); });
  std::vector<Eigen::Vector3d> points;
  size_t moved = 0;
  for (size_t i = 0; i < corners.size(); ++i) {
    if (!(inverse_depths[i] > 0)) continue;
    constexpr double kClearPixels = 4;
    moved += inverse_depths[i] * search.max >= kClearPixels ? 1 : 0;
    points.push_back(frame.cam_from_world.inverse() * frame.camera.Unproject(corners[i], 1 / inverse_depths[i]));
  }
  if (2 * moved < points.size()) return std::nullopt;
  return DepthRangeFromLandmarks(points, frame.camera, frame.cam_from_world, options);
}

}  // namespace acmp
