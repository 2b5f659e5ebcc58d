#pragma once

#include <deque>
#include <list>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/dense_mapper.h"
#include "window_keyframe.h"

namespace acmp {

struct Failure {
  std::string reason;
  std::string message;
};

/// Runs `work`; what it throws becomes a value, so that one keyframe's failure does not reach the others.
template <class Work>
std::optional<Failure> CatchFailure(const Work& work) {
  try {
    work();
    return std::nullopt;
  } catch (const InvalidInputError& error) {
    return Failure{"invalid_input", error.what()};
  } catch (const std::bad_alloc&) {
    return Failure{"processing_error", "out of memory"};
  } catch (const std::exception& error) {
    return Failure{"processing_error", error.what()};
  }
}

/// The schedule is in dense_mapper.cpp, what is done again in dense_mapper_again.cpp and, at a flush, in
/// dense_mapper_joint.cpp, what computes and exchanges estimates in dense_mapper_estimates.cpp.
struct DenseMapper::Impl {
  /// Source views of one keyframe, best first.
  struct Sources {
    std::vector<WindowKeyframePtr> keyframes;
    std::vector<int64_t> ids;
    double score = 0;  ///< sum of theirs
  };

  Impl(DepthEngine* depth_engine, const DenseMapperOptions& mapper_options, Callbacks mapper_callbacks,
       const ShardOptions& mapper_shard);

  bool Admit(FramePtr frame);
  std::optional<DepthRange> FindDepthRange(const Frame& frame);
  void EstimatePending(int min_source_views);
  void ReestimateBest(WindowKeyframe* newest);
  void ScheduleOlderThan(size_t later_keyframes);
  ScheduledRefinement MakeRefinement(const WindowKeyframePtr& keyframe, Sources sources) const;
  void Schedule(const WindowKeyframePtr& keyframe);
  bool CanBeRefinedAgain(const WindowKeyframe& keyframe) const;
  bool IsWantedAgain(const WindowKeyframe& keyframe) const;
  static bool HasBetterMaps(const WindowKeyframe& keyframe, const Sources& sources);
  void RefineAgain(const WindowKeyframePtr& keyframe);
  void RefineAgainHalfway();
  static bool HasBetterViews(const WindowKeyframe& keyframe, const Sources& sources);
  static bool HasStaleFast(const WindowKeyframe& keyframe, const Sources& sources);

  struct Member;
  std::vector<WindowKeyframePtr> FindGaining();
  std::vector<Member> MakeMembers(const std::vector<WindowKeyframePtr>& keyframes);
  static EngineProblem ReadTogether(std::optional<EstimateStage> ScheduledRefinement::Source::*stage,
                                    const std::vector<Member>& members, const Member& reader);
  template <class Work>
  void ForActive(std::vector<Member>* members, const Work& work);
  void StepTogether(int step, std::vector<Member>* members);
  void RefineWindowAgain();
  void ScoreViewsAnew();
  bool HasFewLater(const WindowKeyframe& keyframe) const;
  void EvictUntil(int keyframes_left);

  std::vector<WindowKeyframePtr> Others(const WindowKeyframe& keyframe) const;
  SourceViewSelector& SelectorOf(WindowKeyframe* keyframe) const;
  Sources SelectSources(WindowKeyframe* keyframe) const;
  std::string DescribeMissing(WindowKeyframe* keyframe, int min_source_views) const;

  bool IsOwn(const WindowKeyframe& keyframe) const { return keyframe.shard == shard.index; }
  int ShardOf(int64_t id) const;
  void Drop(WindowKeyframe* keyframe, const std::string& reason, const std::string& message);
  void Report(const KeyframeDrop& drop) const;

  EngineView MakeView(WindowKeyframe* keyframe);
  std::shared_ptr<KeyframeDepth> MakeKeyframeDepth(const WindowKeyframe& keyframe, const EngineEstimatePtr& estimate,
                                                   std::vector<int64_t> source_ids);
  EngineProblem MakeInitialProblem(WindowKeyframe* keyframe, const Sources& sources);
  void Estimate(WindowKeyframe* keyframe, const Sources& sources);
  void Reestimate(WindowKeyframe* keyframe, const Sources& sources);
  void Refine(const ScheduledRefinement& refinement);
  bool RunAgain(const ScheduledRefinement& refinement, const EngineEstimatePtr& start);
  void ReportFailedAgain(const WindowKeyframe& keyframe, const Failure& failure) const;
  KeyframeDepthPtr MakeRefined(const ScheduledRefinement& refinement, const EngineEstimatePtr& start,
                               EngineEstimatePtr* for_others);
  EngineProblem MakeRefinementProblem(const ScheduledRefinement& refinement);
  bool IsReady(const ScheduledRefinement& refinement) const;
  void RunReady();

  void Publish(const WindowKeyframe& keyframe, EstimateStage stage, const EngineEstimatePtr& estimate) const;
  void AdmitPeer(const WindowKeyframePtr& keyframe);
  void SettlePeer(WindowKeyframe* keyframe, ShardEstimate estimate);
  void KeepForLater(ShardEstimate estimate);
  void ReportProblem(const char* reason, const std::string& message) const;

  DenseMapperOptions options;
  Callbacks callbacks;
  const ShardOptions shard;
  DepthEngine* engine;
  DepthEstimator estimator;
  std::deque<WindowKeyframePtr> window;    ///< oldest first
  std::vector<WindowKeyframePtr> leaving;  ///< that the keyframe under way has moved out of it and may be refined again
  std::list<ScheduledRefinement> waiting;  ///< own ones, in the order of the schedule
  std::optional<DepthRange> last_range;
  std::optional<int64_t> last_id;
  int64_t refinements = 0;  ///< made here so far

  // With several shards.
  std::map<int64_t, std::weak_ptr<WindowKeyframe>> peer_keyframes;  ///< that somebody may still read
  std::multimap<int64_t, ShardEstimate> early;                      ///< by id, of keyframes that are still to come
  std::set<int> lost_shards;                                        ///< nothing waits for these
};

}  // namespace acmp
