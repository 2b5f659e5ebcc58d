#include "keyframe_window.h"

#include <algorithm>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

PosedCamera CameraOf(const Frame& frame) { return {frame.camera, frame.cam_from_world}; }

/// Source views count as better when the sum of their scores has grown so much. A keyframe has one chance halfway
/// through the window and one at a flush, so that little is worth the work: 1.1 and 1.25 cost the same in a stream.
constexpr double kBetterScore = 1.1;

/// px, mean of nine points of the keyframe's image over the views that are still there.
double MeanShift(const WindowKeyframe& keyframe, const std::vector<MatchedView>& views) {
  const PinholeCamera& camera = keyframe.frame->camera;
  const double depth =
      TypicalDepth(keyframe.range) / (keyframe.capture->refined ? keyframe.capture->refined->scale : 1);
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
      if (!source_camera.Contains(pixel_then)) continue;
      sum += (source_camera.Project(now) - pixel_then).norm();
      ++count;
    }
  }
  return count == 0 ? 0 : sum / count;
}

}  // namespace

RefinedPlace RefinedPlace::Moved(RigidTransform motion) const {
  RefinedPlace moved = *this;
  moved.placed = motion * placed;
  motion.translation() /= static_cast<float>(scale);  // as depths are
  moved.cam_from_world = motion * cam_from_world;
  return moved;
}

std::optional<RefinedPlace> WindowKeyframe::refined_place() const {
  if (!capture->refined) return std::nullopt;
  return capture->refined->Moved(camera_from_capture);
}

RigidTransform WindowKeyframe::cam_from_world() const {
  return capture->refined ? refined_place()->cam_from_world : frame->cam_from_world;
}

WindowCapture::WindowCapture(const Capture& capture) : pose(std::make_shared<CapturePose>()) {
  for (const bool is_mapped : {true, false}) {
    for (const FramePtr& frame : is_mapped ? capture.keyframes : capture.companions) {
      auto image = std::make_shared<WindowKeyframe>();
      image->frame = frame;
      image->capture = pose;
      image->is_mapped = is_mapped;
      if (!is_mapped) image->state = WindowKeyframe::State::kFinished;
      if (images.empty()) {
        pose->id = frame->id;
        pose->capture_from_world = frame->cam_from_world;
      } else {
        image->camera_from_capture = frame->cam_from_world * pose->capture_from_world.inverse();
      }
      images.push_back(std::move(image));
    }
  }
}

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

std::vector<int64_t> SourceViews::Ids() const {
  std::vector<int64_t> ids;
  ids.reserve(keyframes.size());
  for (const WindowKeyframePtr& keyframe : keyframes) ids.push_back(keyframe->frame->id);
  return ids;
}

void KeyframeWindow::set_max_source_views(int max_source_views) {
  if (max_source_views == max_source_views_) return;
  max_source_views_ = max_source_views;
  for (const WindowKeyframePtr& keyframe : Images()) {
    if (!keyframe->initial && !keyframe->refined_score) continue;
    keyframe->initial_score = SelectSources(*keyframe).score;
    if (keyframe->refined_score) keyframe->refined_score = keyframe->initial_score;
  }
}

SourceViews KeyframeWindow::SelectSources(const WindowKeyframe& keyframe) const {
  const auto select = [&](const Candidates& candidates, std::vector<WindowKeyframePtr>* selected) {
    const SourceViewSelection selection =
        SelectSourceViews(CameraOf(*keyframe.frame), keyframe.range, candidates.views, max_source_views_);
    for (const SelectedSourceView& view : selection.views) selected->push_back(candidates.keyframes[view.index]);
    return selection.gain;
  };
  SourceViews sources;
  sources.score = select(CandidatesOf(keyframe, keyframe.is_mapped), &sources.keyframes);
  select(CandidatesOf(keyframe, false), &sources.of_capture);
  return sources;
}

std::string KeyframeWindow::DescribeMissingViews(const WindowKeyframe& keyframe, int min_source_views) const {
  const std::string name = Concat("keyframe ", keyframe.frame->id, ": ");
  const Candidates others = CandidatesOf(keyframe, keyframe.is_mapped);
  if (others.keyframes.empty()) {
    return Concat(name, "no other keyframe in the window, at least ", min_source_views, " needed");
  }
  const SourceViewSelection selection =
      SelectSourceViews(CameraOf(*keyframe.frame), keyframe.range, others.views, max_source_views_);
  std::string text = Concat(name, selection.num_useful, " of ", others.keyframes.size(),
                            " other images in the window useful, at least ", min_source_views, " needed");
  if (selection.num_without_baseline > 0) {
    text += Concat("; ", selection.num_without_baseline, " with no baseline (identical position)");
  }
  if (selection.num_without_overlap > 0) {
    text += Concat("; ", selection.num_without_overlap, " see less than ", 100 * kMinSourceOverlap, " % of its scene");
  }
  if (selection.num_with_small_angle > 0) {
    text += Concat("; ", selection.num_with_small_angle, " below the least triangulation angle of ", kMinSourceAngleDeg,
                   " degrees (largest found: ", selection.largest_small_angle_deg, ")");
  }
  return text;
}

size_t KeyframeWindow::NumLaterThan(const WindowKeyframe& keyframe) const {
  return static_cast<size_t>(std::count_if(captures_.begin(), captures_.end(), [&](const WindowCapture& capture) {
    return capture.pose->id > keyframe.capture->id;
  }));
}

std::vector<WindowKeyframePtr> KeyframeWindow::Images() const {
  std::vector<WindowKeyframePtr> images;
  for (const WindowCapture& capture : captures_) {
    images.insert(images.end(), capture.images.begin(), capture.images.end());
  }
  return images;
}

KeyframeWindow::Candidates KeyframeWindow::CandidatesOf(const WindowKeyframe& keyframe, bool of_all_captures) const {
  constexpr int kMapped = 1, kNotMapped = 0;  // priorities
  Candidates candidates;
  for (const WindowCapture& capture : captures_) {
    const bool is_own = capture.pose == keyframe.capture;
    if (!is_own && !of_all_captures) continue;
    for (const WindowKeyframePtr& image : capture.images) {
      if (image.get() == &keyframe) continue;
      const bool is_companion = !image->is_mapped && capture.images.front()->is_mapped;  // else the capture is left out
      if (is_companion && !is_own) continue;
      candidates.keyframes.push_back(image);
      candidates.views.push_back({CameraOf(*image->frame), is_own || image->is_mapped ? kMapped : kNotMapped});
    }
  }
  return candidates;
}

}  // namespace acmp
