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
#include "output_queue.h"
#include "window_keyframe.h"

namespace acmp {

struct Failure {
  std::string reason;
  std::string message;
};

/// An estimate on its way to a callback.
struct EstimateOutput {
  EngineProblem problem;  ///< the reference's estimate is the one; the sources' are for the consistency check
  std::vector<int64_t> source_ids;
  StageTimes times;
  std::optional<FusionOptions> consistency;  ///< none: a fast estimate, which is not checked
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
/// dense_mapper_joint.cpp, what computes and exchanges estimates in dense_mapper_estimates.cpp, what becomes of
/// finished ones in dense_mapper_outputs.cpp.
struct DenseMapper::Impl {
  /// Source views of one keyframe, best first.
  struct Sources {
    std::vector<WindowKeyframePtr> keyframes;
    std::vector<int64_t> ids;
    double score = 0;  ///< sum of theirs
  };

  Impl(DepthEngine* depth_engine, const DenseMapperOptions& mapper_options, Callbacks mapper_callbacks,
       const ShardOptions& mapper_shard, DepthEngine* engine_of_outputs);

  bool Admit(FramePtr frame);
  std::optional<DepthRange> FindDepthRange(const Frame& frame);
  void EstimatePending(int min_source_views);
  void ReestimateBest(WindowKeyframe* newest);
  void ScheduleOlderThan(size_t later_keyframes);
  ScheduledRefinement MakeRefinement(const WindowKeyframePtr& keyframe, Sources sources) const;
  void Schedule(const WindowKeyframePtr& keyframe);
  bool CanBeRefinedAgain(const WindowKeyframe& keyframe) const;
  bool IsWantedAgain(const WindowKeyframe& keyframe);
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
  void Drop(const WindowKeyframePtr& keyframe, const std::string& reason, const std::string& message);

  EngineView MakeView(WindowKeyframe* keyframe);
  EngineProblem MakeInitialProblem(WindowKeyframe* keyframe, const Sources& sources);
  void Estimate(const WindowKeyframePtr& keyframe, const Sources& sources);
  void Reestimate(WindowKeyframe* keyframe, const Sources& sources);
  void Refine(const ScheduledRefinement& refinement);
  bool RunAgain(const ScheduledRefinement& refinement, const EngineEstimatePtr& start);
  void ReportFailedAgain(int64_t id, const Failure& failure);
  /// @param for_others what keyframes read of it afterwards
  EstimateOutput MakeRefined(const ScheduledRefinement& refinement, const EngineEstimatePtr& start,
                             EngineEstimatePtr* for_others);
  EngineProblem MakeRefinementProblem(const ScheduledRefinement& refinement);
  bool IsReady(const ScheduledRefinement& refinement) const;
  void RunReady();

  void SubmitFast(const WindowKeyframePtr& keyframe, EstimateOutput output);
  uint64_t SubmitRefined(const WindowKeyframePtr& keyframe, EstimateOutput output);
  void SubmitRefinedAgain(EstimateOutput output);
  /// @param keyframe null: was never in the window
  void SubmitDrop(KeyframeDrop drop, WindowKeyframePtr keyframe);
  KeyframeDepthPtr Finish(const EstimateOutput& output) const;
  void CallProblem(const char* reason, const std::string& message) const;

  void Publish(const WindowKeyframe& keyframe, EstimateStage stage, const EngineEstimatePtr& estimate);
  void AdmitPeer(const WindowKeyframePtr& keyframe);
  void SettlePeer(WindowKeyframe* keyframe, ShardEstimate estimate);
  void KeepForLater(ShardEstimate estimate);
  void ReportProblem(const char* reason, std::string message);

  DenseMapperOptions options;
  Callbacks callbacks;
  const ShardOptions shard;
  DepthEngine* engine;
  DepthEngine* output_engine;  ///< of jobs
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

  OutputQueue outputs;  ///< last: its jobs use what is above
};

}  // namespace acmp
