#include "refinement_policy.h"

#include <algorithm>

#include "pose_shift.h"

namespace acmp {
namespace {

/// With two later keyframes initial estimates serve others better than refined ones, with five the refined ones.
constexpr size_t kEnoughLaterKeyframes = 3;

/// Source views count as better when the sum of their scores has grown so much. A keyframe has one chance halfway
/// through the window and one at a flush, so that little is worth the work: 1.1 and 1.25 cost the same in a stream.
constexpr double kBetterScore = 1.1;

bool HasBetterViews(const WindowKeyframe& keyframe, const SourceViews& sources) {
  return sources.score >= kBetterScore * *keyframe.refined_score;
}

/// Whether a source view was refined again since these maps were made. That counts once, for such gains soon end, and
/// only where that source's own views had become better: else it would go on from keyframe to keyframe.
bool HasBetterMaps(const WindowKeyframe& keyframe, const SourceViews& sources) {
  if (keyframe.has_read_better_maps || sources.score < *keyframe.refined_score) return false;
  return std::any_of(sources.keyframes.begin(), sources.keyframes.end(), [&](const WindowKeyframePtr& source) {
    return source->refined_again_at > keyframe.refined_at && !source->has_read_better_maps;
  });
}

}  // namespace

RefinementPolicy::Again RefinementPolicy::Decide(const WindowKeyframe& keyframe, const SourceViews& sources) {
  if (!keyframe.refined_score) return Again::kNo;
  if (HasBetterViews(keyframe, sources) || HaveMoved(keyframe, keyframe.refined_views)) return Again::kFromInitial;
  if (keyframe.refined && HasBetterMaps(keyframe, sources)) return Again::kFromRefined;
  return Again::kNo;
}

std::vector<std::pair<WindowKeyframePtr, SourceViews>> RefinementPolicy::ChooseForSideBySide(
    const KeyframeWindow& window, const std::vector<WindowKeyframePtr>& keyframes) {
  std::vector<std::pair<WindowKeyframePtr, SourceViews>> chosen;
  bool any_gains = false;
  for (const WindowKeyframePtr& keyframe : keyframes) {
    SourceViews sources = window.SelectSources(*keyframe);
    any_gains = any_gains || HasBetterViews(*keyframe, sources) || HaveMoved(*keyframe, keyframe->refined_views);
    if (sources.score >= *keyframe->refined_score) chosen.emplace_back(keyframe, std::move(sources));
  }
  if (!any_gains) chosen.clear();
  return chosen;
}

bool RefinementPolicy::NeedsNewInitial(const WindowKeyframe& keyframe, const SourceViews& sources) {
  return !keyframe.initial || sources.score >= kBetterScore * keyframe.initial_score ||
         HaveMoved(keyframe, keyframe.initial_views);
}

bool RefinementPolicy::LacksFutureViews(const KeyframeWindow& window, const WindowKeyframe& keyframe) {
  return window.NumLaterThan(keyframe) < kEnoughLaterKeyframes;
}

}  // namespace acmp
