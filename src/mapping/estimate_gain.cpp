#include "estimate_gain.h"

#include "acmp_mapping/keyframe/source_view_selection.h"

namespace acmp {
namespace {

/// Source views count as better when the sum of their scores has grown so much. A keyframe has one chance halfway
/// through the window and one at a flush, so that little is worth the work: 1.1 and 1.25 cost the same in a stream.
constexpr double kBetterScore = 1.1;

bool IsInImage(const Eigen::Vector2d& pixel, const PinholeCamera& camera) {
  return pixel.x() > -0.5 && pixel.y() > -0.5 && pixel.x() < camera.width - 0.5 && pixel.y() < camera.height - 0.5;
}

/// px, mean of nine points of the keyframe's image over the views that are still there.
double MeanShift(const WindowKeyframe& keyframe, const std::vector<MatchedView>& views) {
  const PinholeCamera& camera = keyframe.frame->camera;
  const double depth = TypicalDepth(keyframe.range) / keyframe.pose.placed.scale;
  double sum = 0;
  int count = 0;
  for (const MatchedView& view : views) {
    const std::shared_ptr<const WindowKeyframe> source = view.source.lock();
    if (!source) continue;
    const PinholeCamera& source_camera = source->frame->camera;
    const RigidTransform source_from_reference = source->cam_from_world() * keyframe.cam_from_world().inverse();
    for (int i = 0; i < 9; ++i) {
      const int col = i % 3, row = i / 3;
      const Eigen::Vector2d pixel(0.25 * (1 + col) * camera.width, 0.25 * (1 + row) * camera.height);
      const Eigen::Vector3d point = camera.Unproject(pixel, depth);
      const Eigen::Vector3d then = view.source_from_reference * point, now = source_from_reference * point;
      if (!(then.z() > 0 && now.z() > 0)) continue;
      const Eigen::Vector2d pixel_then = source_camera.Project(then);
      // Outside of the view nothing is matched, and perspective makes pixels large.
      if (!IsInImage(pixel_then, source_camera)) continue;
      sum += (source_camera.Project(now) - pixel_then).norm();
      ++count;
    }
  }
  return count == 0 ? 0 : sum / count;
}

}  // namespace

bool HaveMoved(const WindowKeyframe& keyframe, const std::vector<MatchedView>& views) {
  constexpr double kMax_px = 1;
  return MeanShift(keyframe, views) > kMax_px;
}

bool WouldGain(const WindowKeyframe& keyframe, const SourceViews& sources) {
  return sources.score >= kBetterScore * *keyframe.refined_score || HaveMoved(keyframe, keyframe.refined_views);
}

bool NeedsNewInitial(const WindowKeyframe& keyframe, const SourceViews& sources) {
  const bool is_refined_again = keyframe.state == WindowKeyframe::State::kFinished;
  return !keyframe.initial || HaveMoved(keyframe, keyframe.initial_views) ||
         (is_refined_again && sources.score >= kBetterScore * keyframe.initial_score);
}

}  // namespace acmp
