// Keyframes of the window for which better source views have come: estimated anew for others to read, or refined again
// for the map.

#include <algorithm>
#include <utility>

#include "dense_mapper_impl.h"

namespace acmp {
namespace {

/// A keyframe is estimated anew when the sum of its source views' scores has grown so much: 1.2 brings more work and no
/// more, with 2 some of the gain is lost (docs/quality.md).
constexpr double kMinScoreGrowth = 1.5;

/// A keyframe is refined again when it has grown so much since its maps were made. That is tried twice, so that less is
/// worth the work: 1.1 and 1.25 cost the same in the stream of acmp_benchmark, 1 costs 7 % of its rate.
constexpr double kMinAgainGrowth = 1.1;

}  // namespace

/// Of the new keyframe's source views those that gain most by it as a source view of theirs.
void DenseMapper::Impl::ReestimateBest(WindowKeyframe* newest) {
  if (options.reestimates == 0 || shard.count > 1 || !newest->views_score) return;
  struct Candidate {
    WindowKeyframePtr keyframe;
    Sources sources;
    double growth;
  };
  std::vector<Candidate> candidates;
  for (const WindowKeyframePtr& keyframe : SelectSources(newest).keyframes) {
    if (!keyframe->stage || !keyframe->views_score) continue;
    Sources sources = SelectSources(keyframe.get());
    const double growth = sources.score / std::max(*keyframe->views_score, keyframe->tried_score);
    if (growth >= kMinScoreGrowth) candidates.push_back({keyframe, std::move(sources), growth});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.growth > b.growth; });
  candidates.resize(std::min(candidates.size(), static_cast<size_t>(options.reestimates)));
  for (const Candidate& candidate : candidates) Reestimate(candidate.keyframe.get(), candidate.sources);
}

bool DenseMapper::Impl::CanBeRefinedAgain(const WindowKeyframe& keyframe) const {
  return options.refine_again && shard.count == 1 && keyframe.refined_score;
}

bool DenseMapper::Impl::IsWantedAgain(const WindowKeyframe& keyframe) {
  if (!CanBeRefinedAgain(keyframe)) return false;
  outputs.WaitFor(keyframe.output);
  return keyframe.had_refined && (!callbacks.wants_refined_again || callbacks.wants_refined_again(keyframe.frame->id));
}

bool DenseMapper::Impl::HasBetterViews(const WindowKeyframe& keyframe, const Sources& sources) {
  return sources.score >= kMinAgainGrowth * *keyframe.refined_score;
}

/// Whether others should not go on from its fast estimate.
bool DenseMapper::Impl::HasStaleFast(const WindowKeyframe& keyframe, const Sources& sources) {
  return !keyframe.fast || sources.score >= kMinAgainGrowth * *keyframe.views_score;
}

/// Whether a source view has been refined again since these maps were made. It counts once, for such gains soon end,
/// and only where that source's views had become better: it would go on from keyframe to keyframe.
bool DenseMapper::Impl::HasBetterMaps(const WindowKeyframe& keyframe, const Sources& sources) {
  if (keyframe.has_read_better_maps || sources.score < *keyframe.refined_score) return false;
  return std::any_of(sources.keyframes.begin(), sources.keyframes.end(), [&](const WindowKeyframePtr& source) {
    return source->again_at > keyframe.refined_at && !source->has_read_better_maps;
  });
}

/// Makes the maps of a finished keyframe anew if its source views have become better, or their maps have.
void DenseMapper::Impl::RefineAgain(const WindowKeyframePtr& keyframe) {
  if (!IsWantedAgain(*keyframe)) return;
  Sources sources = SelectSources(keyframe.get());
  const bool has_better_views = HasBetterViews(*keyframe, sources);
  if (!has_better_views && !HasBetterMaps(*keyframe, sources)) return;
  if (has_better_views && HasStaleFast(*keyframe, sources)) Reestimate(keyframe.get(), sources);
  const EngineEstimatePtr start = has_better_views || !keyframe->refined ? keyframe->fast : keyframe->refined;
  if (!start) return;
  const bool had_few_later = std::exchange(keyframe->few_later, HasFewLater(*keyframe));
  if (!RunAgain(MakeRefinement(keyframe, std::move(sources)), start)) {
    keyframe->few_later = had_few_later;
    return;
  }
  keyframe->again_at = keyframe->refined_at;
  keyframe->has_read_better_maps = !has_better_views;
}

/// The keyframe that has as many later ones as earlier ones to be matched against, at most.
void DenseMapper::Impl::RefineAgainHalfway() {
  const size_t age = static_cast<size_t>(options.window_size) / 2;
  if (window.size() > age) RefineAgain(window[window.size() - 1 - age]);
}

}  // namespace acmp
