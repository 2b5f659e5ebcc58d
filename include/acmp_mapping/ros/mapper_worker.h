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
#include "acmp_mapping/ros/keyframe_numbers.h"
#include "acmp_mapping/ros/latency_window.h"
#include "acmp_mapping/ros/map_store.h"
#include "acmp_mapping/ros/shared_options.h"
#include "acmp_mapping/ros/work_queue.h"

namespace acmp {

/// A keyframe's maps ready to be published.
struct KeyframeOutput {
  KeyframeDepthPtr maps;
  int64_t stamp_ns = 0;  ///< of the image
  std::string camera_frame;
  std::string world_frame;
  RigidTransform world_from_cam = RigidTransform::Identity();
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
  uint64_t of_others = 0;                       ///< keyframes that are other shards'
  size_t waiting = 0;                           ///< refinements that wait for other shards
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
    // The others from both threads at the same time.
    std::function<void(const Drop&)> on_drop;
    // With several shards, of own keyframes.
    std::function<void(const ShardEstimate&, int64_t stamp_ns)> on_own_estimate;
    std::function<void(int64_t number, int64_t stamp_ns, const std::string& reason)> on_dropped_keyframe;
    std::function<void(int64_t number)> on_flush;  ///< Flush was called after the keyframe of this number
  };

  /// @param options, map, numbers outlive the worker
  MapperWorker(const NodeOptions& node_options, const SharedOptions* options, MapStore* map, KeyframeNumbers* numbers,
               Hooks hooks);
  ~MapperWorker();
  MapperWorker(const MapperWorker&) = delete;
  MapperWorker& operator=(const MapperWorker&) = delete;

  /// Queues a keyframe. With overload: block, waits for room.
  void Push(KeyframeInput input);

  /// Finishes all keyframes queued and pending. Empty when done, else why not. With several shards, the others are told
  /// to do the same after the last keyframe queued here, since each needs the others' estimates.
  std::string Flush();

  /// From other shards: an estimate, and that they were flushed after the keyframe of this number.
  void AddPeerEstimate(ShardEstimate estimate);
  void FlushAfter(int64_t number);
  /// To be called some times a second: ends waits for other shards that have taken shard_timeout.
  void CheckWaiting();

  /// After all that is queued: finishes what is pending, then forgets the window, with `clear_map` the map too.
  void StartOver(bool clear_map);

  /// Forgets what is queued, window and map. Empty when done, else why not.
  std::string Reset();

  /// Wakes all who wait and ends the thread after the keyframe it is at.
  void Stop();

  WorkerStatus status() const;
  size_t queued() const { return queue_.waiting_inputs(); }

 private:
  using Command = std::function<void()>;
  struct NumberedInput {
    KeyframeInput keyframe;
    int64_t number;
  };
  /// What is known of a keyframe beside its frame.
  struct Record {
    int64_t stamp_ns;
    double arrival_s;
    std::string camera_frame;
    std::string world_frame;
    RigidTransform world_from_cam;
    cv::Mat valid;  ///< where the rectified image is known, matched size; empty = everywhere
  };
  using RecordPtr = std::shared_ptr<const Record>;
  using Records = std::map<int64_t, RecordPtr>;

  void Run();
  void MakeMapper();
  void Process(const NumberedInput& input);
  FramePtr PrepareFrame(const NumberedInput& input, const FrameOptions& options, cv::Mat* valid);
  /// Null: none.
  RecordPtr FindRecord(const Records& records, int64_t id) const;
  static double LatencyMs(const Record& record);
  bool MustWait() const;
  void FinishWaits();
  KeyframeOutput MakeOutput(const KeyframeDepthPtr& maps, const Record& record) const;
  void HandleFast(const KeyframeDepthPtr& maps);
  void HandleRefined(const KeyframeDepthPtr& maps);
  void HandleRefinedAgain(const KeyframeDepthPtr& maps);
  void Publish(const std::function<void(const KeyframeOutput&)>& hook, const KeyframeOutput& output) const;
  void HandleDrop(const KeyframeDrop& drop);
  void ReportDrop(const Drop& drop) const;
  bool IsOwn(int64_t number) const { return number % node_options_.shard.count == node_options_.shard.index; }
  void ReportUnmapped(const NumberedInput& input, const Drop& drop) const;
  /// Has the worker do `work` and waits until that calls done, at once or later. Empty then, else why not.
  std::string RunCommand(bool urgent, const std::function<void(const std::function<void()>& done)>& work);
  template <class Change>
  void UpdateStatus(const Change& change) {
    const std::lock_guard<std::mutex> lock(status_mutex_);
    change(&status_);
  }

  const NodeOptions node_options_;
  const SharedOptions* const options_;
  MapStore* const map_;
  KeyframeNumbers* const numbers_;
  const Hooks hooks_;
  WorkQueue<NumberedInput, Command> queue_;
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
  int64_t last_number_ = -1;                          ///< of the last keyframe taken from the queue
  std::optional<int64_t> flush_after_;                ///< a peer was flushed after this keyframe
  std::vector<std::function<void()>> when_finished_;  ///< to be done when nothing waits for other shards
  std::optional<int64_t> oldest_waiting_;
  double waiting_since_s_ = 0;

  std::thread thread_;  // last: it starts when everything above exists
};

}  // namespace acmp
