#pragma once

#include <string>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "failure.h"
#include "keyframe_estimator.h"
#include "output_queue.h"

namespace acmp {

/// For on_problem.
std::string DescribeFailedAgain(int64_t id, const Failure& failure);

/// What becomes of finished estimates: their maps come to the host, are checked for consistency and go to the
/// callbacks, in the order they were given. With an engine of its own it does so in a thread of its own.
class MapperOutputs {
 public:
  /// @param engine makes the maps; outlives this
  MapperOutputs(DepthEngine* engine, bool has_thread, DenseMapper::Callbacks callbacks)
      : engine_(engine), callbacks_(std::move(callbacks)), queue_(has_thread) {}

  void SubmitFast(const WindowKeyframePtr& keyframe, FinishedEstimate estimate);
  /// @param again these are better maps of a keyframe whose refined ones were submitted before
  void SubmitRefined(const WindowKeyframePtr& keyframe, FinishedEstimate estimate, const FusionOptions& consistency,
                     bool again);
  /// Tells that the keyframe's maps must not be used any more, if it had any.
  void SubmitWithdrawal(const WindowKeyframePtr& keyframe, const std::string& message);
  /// @param keyframe null: was never in the window
  void SubmitDrop(const FramePtr& frame, const Failure& failure, const WindowKeyframePtr& keyframe);
  void SubmitProblem(const char* reason, const std::string& message);

  void WaitForAll() { queue_.WaitForAll(); }

 private:
  KeyframeDepthPtr MakeFast(const FinishedEstimate& estimate) const;
  KeyframeDepthPtr MakeRefined(const FinishedEstimate& estimate, const FusionOptions& consistency) const;
  void CallDrop(const KeyframeDrop& drop) const;
  void CallProblem(const char* reason, const std::string& message) const;

  DepthEngine* engine_;
  DenseMapper::Callbacks callbacks_;
  OutputQueue queue_;  ///< last: its jobs use what is above
};

}  // namespace acmp
