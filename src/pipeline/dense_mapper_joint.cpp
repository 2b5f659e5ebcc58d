// Keyframes of the window that are refined again together, at a flush: what is to come has come, so that all can take
// their steps side by side, as the offline schedule does.

#include <algorithm>
#include <utility>

#include "dense_mapper_impl.h"

namespace acmp {

/// A keyframe on its way through the steps that all take together.
struct DenseMapper::Impl::Member {
  ScheduledRefinement refinement;
  EngineProblem problem;         ///< without estimates
  EngineEstimatePtr estimate;    ///< of the step before, which members read
  EngineEstimatePtr next;        ///< of this step
  EngineEstimatePtr for_others;  ///< what keyframes read of it afterwards
  bool is_active = true;         ///< has not failed, and is still wanted
};

/// Those whose source views have become better, those that read one of them, those that read one of these, and so on;
/// but not where their own have become worse, as some have left the window.
std::vector<WindowKeyframePtr> DenseMapper::Impl::FindGaining() {
  std::vector<std::pair<WindowKeyframePtr, Sources>> others;
  std::vector<WindowKeyframePtr> gaining;
  for (const WindowKeyframePtr& keyframe : window) {
    if (!IsWantedAgain(*keyframe)) continue;
    Sources sources = SelectSources(keyframe.get());
    if (HasBetterViews(*keyframe, sources)) {
      gaining.push_back(keyframe);
    } else if (sources.score >= *keyframe->refined_score) {
      others.emplace_back(keyframe, std::move(sources));
    }
  }
  for (size_t i = 0; i < gaining.size(); ++i) {
    const auto reads = [&](const auto& other) {
      const std::vector<WindowKeyframePtr>& sources = other.second.keyframes;
      return std::find(sources.begin(), sources.end(), gaining[i]) != sources.end();
    };
    const auto first =
        std::stable_partition(others.begin(), others.end(), [&](const auto& other) { return !reads(other); });
    for (auto other = first; other != others.end(); ++other) gaining.push_back(other->first);
    others.erase(first, others.end());
  }
  std::sort(gaining.begin(), gaining.end(), [](const auto& a, const auto& b) { return a->frame->id < b->frame->id; });
  return gaining;
}

/// Estimated anew: what they have was made with worse views, or others have read it and agree with its errors.
std::vector<DenseMapper::Impl::Member> DenseMapper::Impl::MakeMembers(const std::vector<WindowKeyframePtr>& keyframes) {
  for (const WindowKeyframePtr& keyframe : keyframes) {
    if (!IsWantedAgain(*keyframe)) continue;
    const Sources sources = SelectSources(keyframe.get());
    if (HasStaleFast(*keyframe, sources)) Reestimate(keyframe.get(), sources);
  }
  std::vector<Member> members;
  for (const WindowKeyframePtr& keyframe : keyframes) {
    if (!keyframe->fast) continue;
    Member member;
    member.estimate = member.for_others = keyframe->fast;
    member.refinement = MakeRefinement(keyframe, SelectSources(keyframe.get()));
    members.push_back(std::move(member));
  }
  return members;
}

/// What members read of each other is of the step before, of others what a refinement of their own would read.
EngineProblem DenseMapper::Impl::ReadTogether(std::optional<EstimateStage> ScheduledRefinement::Source::*stage,
                                              const std::vector<Member>& members, const Member& reader) {
  EngineProblem problem = reader.problem;
  for (size_t i = 0; i < problem.sources.size(); ++i) {
    const ScheduledRefinement::Source& source = reader.refinement.sources[i];
    const auto member = std::find_if(members.begin(), members.end(),
                                     [&](const Member& other) { return other.refinement.keyframe == source.keyframe; });
    if (member != members.end()) {
      problem.sources[i].estimate = member->estimate;
    } else if (source.*stage) {
      problem.sources[i].estimate = source.keyframe->Estimate(*(source.*stage));
    }
  }
  problem.reference.estimate = reader.estimate;
  return problem;
}

/// Does something for each that is active. Others go on reading what one that fails has last.
template <class Work>
void DenseMapper::Impl::ForActive(std::vector<Member>* members, const Work& work) {
  for (Member& member : *members) {
    const WindowKeyframe& keyframe = *member.refinement.keyframe;
    member.is_active = member.is_active && IsWantedAgain(keyframe);
    if (!member.is_active) continue;
    if (const auto failure = CatchFailure([&] { work(&member); })) {
      member.is_active = false;
      ReportFailedAgain(keyframe.frame->id, *failure);
    }
  }
}

void DenseMapper::Impl::StepTogether(int step, std::vector<Member>* members) {
  const bool is_last_completion = step >= NumRefinementsInPasses(options.pipeline);
  const auto stage =
      is_last_completion ? &ScheduledRefinement::Source::after_passes : &ScheduledRefinement::Source::in_passes;
  ForActive(members, [&](Member* member) {
    member->next = estimator.Refine(ReadTogether(stage, *members, *member), step);
    *member->refinement.keyframe->times += estimator.last_times();
  });
  for (Member& member : *members) {
    if (!member.next) continue;
    const EngineEstimatePtr before = std::exchange(member.estimate, std::exchange(member.next, nullptr));
    const bool hands_on_completed = !is_last_completion || !HasFewLater(*member.refinement.keyframe);
    member.for_others = hands_on_completed ? member.estimate : before;
  }
}

/// First as the offline schedule does it: all are estimated with the views there are now, and in each step read what
/// the one before has made of the others. Then each is refined once more, one after the other: it reads finished maps.
void DenseMapper::Impl::RefineWindowAgain() {
  std::vector<Member> members = MakeMembers(FindGaining());
  ForActive(&members, [&](Member* member) { member->problem = MakeRefinementProblem(member->refinement); });
  for (int step = 0; step < estimator.num_refinements(); ++step) StepTogether(step, &members);
  ForActive(&members, [&](Member* member) {
    WindowKeyframe& keyframe = *member->refinement.keyframe;
    keyframe.few_later = HasFewLater(keyframe);
    keyframe.refined = std::move(member->for_others);
    keyframe.stage = EstimateStage::kRefined;
  });
  for (Member& member : members) member.estimate.reset();
  ForActive(&members, [&](Member* member) {
    const WindowKeyframePtr& keyframe = member->refinement.keyframe;
    if (!RunAgain(MakeRefinement(keyframe, SelectSources(keyframe.get())), keyframe->refined)) return;
    keyframe->again_at = keyframe->refined_at;
    keyframe->has_read_better_maps = true;
  });
}

}  // namespace acmp
