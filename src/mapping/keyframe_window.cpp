#include "keyframe_window.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::vector<FrameLandmarksPtr> LandmarksOf(const std::vector<WindowKeyframePtr>& keyframes) {
  std::vector<FrameLandmarksPtr> landmarks;
  landmarks.reserve(keyframes.size());
  for (const WindowKeyframePtr& keyframe : keyframes) landmarks.push_back(keyframe->landmarks);
  return landmarks;
}

/// Middle of the range in the logarithm: a depth that is as many times the nearest as the farthest is of it.
double TypicalDepth(const DepthRange& range) { return std::sqrt(static_cast<double>(range.min) * range.max); }

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
    keyframe->selector.reset();
    if (keyframe->state == WindowKeyframe::State::kPending) continue;
    keyframe->initial_score = SelectSources(keyframe.get()).score;
    if (keyframe->refined_score) keyframe->refined_score = keyframe->initial_score;
  }
}

WindowKeyframePtr KeyframeWindow::Add(FramePtr frame) {
  auto keyframe = std::make_shared<WindowKeyframe>();
  keyframe->landmarks = std::make_shared<FrameLandmarks>(frame);
  keyframe->placed.cam_from_world = frame->cam_from_world;
  keyframe->frame = std::move(frame);
  keyframes_.push_back(keyframe);
  return keyframe;
}

SourceViews KeyframeWindow::SelectSources(WindowKeyframe* keyframe) const {
  std::vector<WindowKeyframePtr> others = Others(*keyframe);
  const auto images = std::stable_partition(others.begin(), others.end(),
                                            [](const WindowKeyframePtr& other) { return other->is_mapped; });
  SourceViews sources;
  const auto add_best = [&](const std::vector<WindowKeyframePtr>& candidates) {
    for (const RankedSourceView& view : SelectorOf(keyframe).Select(LandmarksOf(candidates))) {
      if (sources.keyframes.size() == static_cast<size_t>(options_.max_source_views)) return;
      sources.keyframes.push_back(candidates[view.index]);
      sources.score += view.score;
    }
  };
  add_best({others.begin(), images});
  add_best({images, others.end()});
  return sources;
}

std::string KeyframeWindow::DescribeMissingViews(WindowKeyframe* keyframe, int min_source_views) const {
  const SourceViewCounts counts = SelectorOf(keyframe).Count(LandmarksOf(Others(*keyframe)));
  const std::string name = Concat("keyframe ", keyframe->frame->id, ": ");
  const int others = counts.useful + counts.no_baseline + counts.little_overlap + counts.small_angle;
  if (others == 0) {
    return Concat(name, "no other keyframe in the window, at least ", min_source_views, " needed");
  }
  std::string text = Concat(name, counts.useful, " of ", others, " other keyframes in the window useful, at least ",
                            min_source_views, " needed");
  if (counts.no_baseline > 0) text += Concat("; ", counts.no_baseline, " with no baseline (identical position)");
  if (counts.little_overlap > 0) {
    text += Concat("; ", counts.little_overlap, " see less than ", 100 * kMinSourceOverlap, " % of its scene");
  }
  if (counts.small_angle > 0) {
    text += Concat("; ", counts.small_angle, " below the least triangulation angle of ", kMinSourceAngleDeg,
                   " degrees (largest found: ", counts.largest_angle_deg, ")");
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

SourceViewSelector& KeyframeWindow::SelectorOf(WindowKeyframe* keyframe) const {
  if (!keyframe->selector) {
    keyframe->selector.emplace(keyframe->landmarks, TypicalDepth(keyframe->range), options_);
  }
  return *keyframe->selector;
}

}  // namespace acmp
