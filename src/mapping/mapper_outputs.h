#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <thread>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "keyframe_estimator.h"

namespace acmp {

/// What an exception said, as a KeyframeDrop tells it.
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

/// Of a keyframe that a reset forgets.
Failure ForgottenByReset(const Frame& frame);
/// For on_problem.
std::string DescribeFailedAgain(int64_t id, const Failure& failure);

/// Runs jobs one after the other in the order they were given: at once, or in a thread of its own. One thread gives
/// them.
class OutputQueue {
 public:
  using Job = std::function<void()>;

  explicit OutputQueue(bool has_thread);
  /// Waits for the job under way; those after it are thrown away.
  ~OutputQueue();
  OutputQueue(const OutputQueue&) = delete;
  OutputQueue& operator=(const OutputQueue&) = delete;

  /// Waits while kMaxJobs have not been done. What a job throws comes out here or in a later call of either method;
  /// jobs after it are run all the same.
  void Submit(Job job);

  void WaitForAll();

  /// Each holds maps on the device; a few let the two threads go on while one of them has more to do than usual.
  static constexpr size_t kMaxJobs = 4;

 private:
  void Run();
  /// Until fewer jobs than these are not done.
  void WaitForFewerThan(size_t jobs);

  std::mutex mutex_;  ///< of all that follows
  std::condition_variable given_, done_;
  std::deque<Job> jobs_;        ///< that have not begun
  size_t unfinished_ = 0;       ///< these and the one under way
  std::exception_ptr failure_;  ///< of the first job that has thrown since this was last told
  bool stopped_ = false;
  std::thread thread_;  ///< last: it starts when everything above exists
};

/// What becomes of the estimates: their maps come to the host, are checked for consistency and go to the
/// callbacks, in the order they were given. With an engine of its own it does so in a thread of its own.
class MapperOutputs {
 public:
  /// @param engine makes the maps; outlives this
  /// @param stop not null, outlives this; once it is requested, refined maps are not made
  MapperOutputs(DepthEngine* engine, bool has_thread, DenseMapper::Callbacks callbacks, StopRequest* stop);

  /// @param steps after the first one
  void SubmitFast(KeyframeSteps steps);
  /// The keyframe is no longer withdrawn, but is again where its maps cannot be made.
  /// @param steps after all of them
  /// @param again these are better maps of a keyframe whose refined ones were submitted before
  void SubmitRefined(KeyframeSteps steps, const FusionOptions& consistency, bool again);
  /// Tells that the keyframe's maps must not be used any more, if it had any.
  void SubmitWithdrawal(const WindowKeyframePtr& keyframe, const std::string& message);
  /// @param keyframe null: was never in the window
  void SubmitDrop(const FramePtr& frame, const Failure& failure, const WindowKeyframePtr& keyframe);
  void SubmitProblem(const char* reason, const std::string& message);

  void WaitForAll() { queue_.WaitForAll(); }

 private:
  KeyframeDepthPtr MakeFast(const KeyframeSteps& steps) const;
  KeyframeDepthPtr MakeRefined(const KeyframeSteps& steps, const FusionOptions& consistency);

  DepthEngine* engine_;
  DenseMapper::Callbacks callbacks_;
  StopRequest* stop_;
  /// Of a run of keyframes without points each so manieth is asked for the reason, so that outputs keep up.
  static constexpr uint64_t kLossesPeriod = 10;
  uint64_t without_points_ = 0;   ///< refined keyframes since the last one with points
  std::string no_points_reason_;  ///< that was found last
  OutputQueue queue_;             ///< last: its jobs use what is above
};

}  // namespace acmp
