#include "keyframe_window.h"

#include <algorithm>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

PosedCamera CameraOf(const Frame& frame) { return {frame.camera, frame.cam_from_world}; }

SourceViewSelection Select(const WindowKeyframe& keyframe, const std::vector<WindowKeyframePtr>& others,
                           const SourceViewOptions& options) {
  std::vector<SourceViewCandidate> candidates;
  candidates.reserve(others.size());
  for (const WindowKeyframePtr& other : others) candidates.push_back({CameraOf(*other->frame), other->is_mapped});
  return SelectSourceViews(CameraOf(*keyframe.frame), TypicalDepth(keyframe.range), candidates, options);
}

}  // namespace

std::vector<int64_t> SourceViews::Ids() const {
  std::vector<int64_t> ids;
  ids.reserve(keyframes.size());
  for (const WindowKeyframePtr& keyframe : keyframes) ids.push_back(keyframe->frame->id);
  return ids;
}

void KeyframeWindow::set_options(const SourceViewOptions& options) {
  if (options == options_) return;
  options_ = options;
  for (const WindowKeyframePtr& keyframe : keyframes_) {
    if (!keyframe->initial && !keyframe->refined_score) continue;
    keyframe->initial_score = SelectSources(*keyframe).score;
    if (keyframe->refined_score) keyframe->refined_score = keyframe->initial_score;
  }
}

WindowKeyframePtr KeyframeWindow::Add(FramePtr frame) {
  auto keyframe = std::make_shared<WindowKeyframe>();
  keyframe->pose.placed.cam_from_world = frame->cam_from_world;
  keyframe->frame = std::move(frame);
  keyframes_.push_back(keyframe);
  return keyframe;
}

SourceViews KeyframeWindow::SelectSources(const WindowKeyframe& keyframe) const {
  const std::vector<WindowKeyframePtr> others = Others(keyframe);
  const SourceViewSelection selection = Select(keyframe, others, options_);
  SourceViews sources;
  for (const SelectedSourceView& view : selection.views) sources.keyframes.push_back(others[view.index]);
  sources.score = selection.gain;
  return sources;
}

std::string KeyframeWindow::DescribeMissingViews(const WindowKeyframe& keyframe, int min_source_views) const {
  const std::string name = Concat("keyframe ", keyframe.frame->id, ": ");
  const std::vector<WindowKeyframePtr> others = Others(keyframe);
  if (others.empty()) {
    return Concat(name, "no other keyframe in the window, at least ", min_source_views, " needed");
  }
  const SourceViewSelection selection = Select(keyframe, others, options_);
  std::string text = Concat(name, selection.num_useful, " of ", others.size(),
                            " other keyframes in the window useful, at least ", min_source_views, " needed");
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

WindowKeyframePtr KeyframeWindow::Find(int64_t id) const {
  const auto found =
      std::find_if(begin(), end(), [&](const WindowKeyframePtr& keyframe) { return keyframe->frame->id == id; });
  return found == end() ? nullptr : *found;
}

size_t KeyframeWindow::NumLaterThan(const WindowKeyframe& keyframe) const {
  return static_cast<size_t>(std::count_if(
      begin(), end(), [&](const WindowKeyframePtr& other) { return other->frame->id > keyframe.frame->id; }));
}

std::vector<WindowKeyframePtr> KeyframeWindow::Others(const WindowKeyframe& keyframe) const {
  std::vector<WindowKeyframePtr> others;
  for (const WindowKeyframePtr& other : keyframes_) {
    if (other.get() != &keyframe) others.push_back(other);
  }
  return others;
}

}  // namespace acmp
