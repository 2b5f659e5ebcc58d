#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/latency_window.h"
#include "acmp_mapping/ros/shared_options.h"
#include "acmp_mapping/ros/work_queue.h"

namespace acmp {

/// A keyframe's maps ready to be published.
struct KeyframeOutput {
  KeyframeOrigin origin;
  uint64_t run = 0;  ///< another number since the last jump of time or reset
  KeyframeDepthPtr maps;
  Image<unsigned char> keep;  ///< 1 where depth is to be published
  PointCloud points_in_camera;
};

/// What the worker tells about itself.
struct WorkerStatus {
  bool ready = false;  ///< the backend exists
  std::string device_name;
  std::string fallback_reason;  ///< why device: auto took the CPU
  std::string device_error;     ///< why there is no backend at all
  uint64_t keyframes = 0;       ///< given to the mapper
  uint64_t fast = 0;
  uint64_t refined = 0;
  uint64_t refined_again = 0;
  int width = 0, height = 0;  ///< matched size of the last keyframe, px
  StageTimes times;           ///< of the last refined keyframe
  double consistency_ms = 0;
  double preparation_ms = 0;                    ///< decoding and rectifying the last image
  double keyframe_ms = 0;                       ///< the last keyframe in the matching thread, all in all
  LatencyWindow fast_latency, refined_latency;  ///< from the image's callback until its map was published
};

/// The one thread that matches: it makes the backend, prepares frames and drives the DenseMapper, which has a thread of
/// its own for outputs. Hooks run in these two, and none begins once Stop has been called.
///
/// Locks: the queue's, status_mutex_ and records_mutex_, each held for a moment and never together; mapper, rectifier
/// and window belong to the worker thread alone.
class MapperWorker {
 public:
  struct Hooks {
    std::function<void(const WorkerStatus&)> on_device;  ///< once, when the backend exists or cannot be made
    // One at a time.
    std::function<void(const KeyframeOutput&)> on_fast;
    std::function<void(const KeyframeOutput&)> on_refined;
    std::function<void(const KeyframeOutput&)> on_refined_again;  ///< better maps of a keyframe that had its on_refined
    // These two from both threads at the same time.
    std::function<bool()> wants_refined_again;  ///< whether anybody would use them
    std::function<void(const RejectedInput&)> on_drop;
  };

  /// @param options outlive the worker
  MapperWorker(const NodeOptions& node_options, const SharedOptions* options, Hooks hooks);
  ~MapperWorker();
  MapperWorker(const MapperWorker&) = delete;
  MapperWorker& operator=(const MapperWorker&) = delete;

  /// Queues a keyframe. With overload: block, waits for room.
  void Push(KeyframeInput input);

  /// Finishes all keyframes queued and pending: their hooks have returned. Empty when done, else why not.
  std::string Flush();

  /// After all that is queued: finishes what is pending, then forgets the window. What comes later is another run.
  void StartOver();

  /// Forgets what is queued and the window. What comes later is another run. Empty when done, else why not.
  std::string Reset();

  /// Wakes all who wait and ends the thread after the keyframe it is at.
  void Stop();

  WorkerStatus status() const;
  size_t queued() const { return queue_.waiting_inputs(); }

 private:
  using Command = std::function<void()>;
  /// What is known of a keyframe beside its frame.
  struct Record {
    KeyframeOrigin origin;
    uint64_t run;
    cv::Mat valid;  ///< where the rectified image is known, matched size; empty = everywhere
  };
  using RecordPtr = std::shared_ptr<const Record>;
  using Records = std::map<int64_t, RecordPtr>;

  void Run();
  void MakeMapper();
  void Process(const KeyframeInput& input);
  FramePtr PrepareFrame(const KeyframeInput& input, const FrameOptions& options, cv::Mat* valid);
  /// Null: none.
  RecordPtr FindRecord(const Records& records, int64_t id) const;
  static double LatencyMs(const Record& record);
  KeyframeOutput MakeOutput(const KeyframeDepthPtr& maps, const Record& record) const;
  void HandleFast(const KeyframeDepthPtr& maps);
  void HandleRefined(const KeyframeDepthPtr& maps);
  void HandleRefinedAgain(const KeyframeDepthPtr& maps);
  void Publish(const std::function<void(const KeyframeOutput&)>& hook, const KeyframeOutput& output) const;
  void HandleDrop(const KeyframeDrop& drop);
  void ReportDrop(const RejectedInput& drop) const;
  /// Has the worker do `work` and waits for it. Empty when done, else why not.
  std::string RunCommand(bool urgent, const std::function<void()>& work);
  template <class Change>
  void UpdateStatus(const Change& change) {
    const std::lock_guard<std::mutex> lock(status_mutex_);
    change(&status_);
  }

  const NodeOptions node_options_;
  const SharedOptions* const options_;
  const Hooks hooks_;
  WorkQueue<KeyframeInput, Command> queue_;
  std::atomic<bool> stopping_{false};

  mutable std::mutex status_mutex_;
  WorkerStatus status_;

  mutable std::mutex records_mutex_;
  Records pending_;  ///< from AddKeyframe to the keyframe's end
  Records refined_;  ///< that may be refined again: the mapper's window, and what has left it on its way out
  std::atomic<double> min_confidence_{0};

  // Used by the worker thread alone.
  std::unique_ptr<DepthEngine> engine_;
  std::unique_ptr<DepthEngine> output_engine_;
  std::unique_ptr<DenseMapper> mapper_;
  std::string device_error_;
  CalibrationPtr calibration_;
  std::unique_ptr<ImageRectifier> rectifier_;
  int64_t next_id_ = 0;  ///< never goes back, whatever stamps do
  uint64_t run_ = 0;

  std::thread thread_;  // last: it starts when everything above exists
};

}  // namespace acmp
