#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <dynamic_reconfigure/server.h>

#include "acmp_mapping/ros/diagnostics.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/mapper_worker.h"
#include "acmp_mapping/ros/nodelet_base.h"
#include "acmp_mapping/ros/options.h"
#include "acmp_mapping/ros/output_publisher.h"
#include "acmp_mapping/ros/tf_lookup.h"

namespace acmp {

/// Wires topics, services and parameters to the mapper; README.md and docs/parameters.md list them.
///
/// Threads: one for input callbacks, which only buffer; the worker, which matches, and those of its mapper for outputs,
/// which publishes, and for poses; one for flush and one for the other services; one for diagnostics and
/// dynamic_reconfigure; one that asks the ROS master.
///
/// Locks: delivery_mutex_ keeps "take from the intake, hand to the worker" in order and may be held while the worker's
/// queue blocks; config_mutex_ is held while parameters change; intake_mutex_ guards the intake for a moment and comes
/// after either. All other locks are inside their classes, and none of those is held while another one is taken.
class DenseMapperNodelet : public NodeletBase {
 public:
  ~DenseMapperNodelet() override;

 private:
  void Start() override;
  void LoadOptions();
  void StartWorker();
  void Subscribe();
  void StartServices();
  void StartReconfigure();
  void LogDevice(const WorkerStatus& status);

  void MakeIntake(const RuntimeOptions& runtime_options);
  void HandleConfig(DenseMapperConfig& config);
  /// Of preset: auto. `text`: what it says of it.
  void UseSetting(const AutoPreset& chosen, const std::string& text);

  /// Takes what the intake has ready and hands it on. `all`: without waiting for clouds.
  void Deliver(bool all = false);
  void Dispatch(IntakeEvent event, bool wait_for_room);
  /// Finishes what was published before the call; says what that was.
  std::string Flush();
  /// Waits for messages that are on their way or in the queues of subscribers: until no image has come for a moment.
  void WaitForArriving();
  std::string Reset();
  std::vector<InputStatus> InputStatuses() const;
  /// Adds what of the poses' meaning may be wrong where they do not fit the images.
  RejectedInput WithDoubt(RejectedInput drop);
  /// Tells which reading of the poses fits the images, where the configured one does not. Returns whether it does.
  bool FindReading();
  MapperSnapshot TakeSnapshot();
  /// The same. Where an input is silent the master is asked what is published under its name.
  MapperSnapshot TakeSnapshotWithAdvice();

  NodeOptions options_;
  std::unique_ptr<SharedOptions> runtime_options_;
  std::vector<RuntimeOptions> auto_options_;  ///< of preset: auto, one for each of its settings; empty: never used
  std::unique_ptr<OutputPublisher> publisher_;
  std::atomic<bool> paused_{false};
  std::atomic<bool> flushing_{false};  ///< its progress is told in the log
  std::atomic<uint64_t> matched_{0};
  uint64_t next_reading_ = 10;  ///< of matched_: when FindReading is called unasked

  std::mutex delivery_mutex_;
  /// Spent in a blocking queue: while it blocks no cloud can come in, so the clock of the wait for clouds stands still.
  double blocked_s_ = 0;
  mutable std::mutex intake_mutex_;
  std::unique_ptr<TfLookup> tf_;  ///< null where nothing is looked up
  std::unique_ptr<KeyframeIntake> intake_;

  std::unique_ptr<MapperWorker> worker_;
  ros::WallTimer missing_timer_;
  ros::WallTimer deliver_timer_;
  std::vector<std::unique_ptr<InputSource>> sources_;
  boost::recursive_mutex config_mutex_;
  std::unique_ptr<dynamic_reconfigure::Server<DenseMapperConfig>> reconfigure_;
  std::unique_ptr<Diagnostics<MapperSnapshot>> diagnostics_;
};

}  // namespace acmp
