#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <dynamic_reconfigure/server.h>
#include <nav_msgs/Path.h>
#include <nodelet/nodelet.h>

#include "acmp_mapping/ros/callback_thread.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/map_output.h"
#include "acmp_mapping/ros/map_server_options.h"
#include "acmp_mapping/ros/mapper_diagnostics.h"
#include "acmp_mapping/ros/mapper_services.h"
#include "acmp_mapping/ros/mapper_worker.h"
#include "acmp_mapping/ros/master_watch.h"
#include "acmp_mapping/ros/output_publisher.h"
#include "acmp_mapping/ros/shard_exchange.h"
#include "acmp_mapping/ros/shared_options.h"
#include "acmp_mapping/ros/tf_lookup.h"

namespace acmp {

/// Wires topics, services and parameters to the mapper; see docs/ for all of them.
///
/// Threads: one for input callbacks, which only buffer; the worker, which matches and publishes keyframes; one for
/// services, which also publishes the map; one for diagnostics, dynamic_reconfigure and optimized_path, where neither
/// images nor the building of a map wait for a long path; one that asks the ROS master; one for what other shards send.
///
/// Locks: delivery_mutex_ keeps "take from the intake, hand to the worker" in order and may be held while the worker's
/// queue blocks; intake_mutex_ guards the intake for a moment. Where both are needed delivery_mutex_ comes first.
/// path_mutex_ keeps "take the path from the map, publish it" in order. All other locks are inside their classes, and
/// none of those is held while another one is taken.
class DenseMapperNodelet : public nodelet::Nodelet {
 public:
  ~DenseMapperNodelet() override;

 private:
  void onInit() override;
  void LoadOptions();
  void StartExchange(MapperWorker::Hooks* hooks);
  void StartWorker();
  void Subscribe();
  void StartServices();
  void StartReconfigure();
  void LogDevice(const WorkerStatus& status);

  void MakeIntake(const RuntimeOptions& runtime_options);
  bool DropWhilePaused(const std_msgs::Header& header);
  /// Runs add(intake) and hands on what has become complete.
  template <class Add>
  void Receive(const Add& add);
  void HandleConfig(DenseMapperConfig& config);
  void HandlePeriod();
  void HandleOptimizedPath(const nav_msgs::Path& message);

  /// Takes what the intake has ready and hands it on. `all`: without waiting for clouds.
  void Deliver(bool all = false);
  void Dispatch(IntakeEvent event);
  void ReportDrop(const Drop& drop);
  /// keyframe_path, as it is in the map now.
  void PublishPath();
  std::string Reset();
  MapperSnapshot TakeSnapshot();

  // First: what is attached to them goes before they do.
  CallbackThread input_thread_;
  CallbackThread service_thread_;
  CallbackThread status_thread_;
  CallbackThread exchange_thread_;

  NodeOptions options_;
  MapServerOptions map_options_;
  std::unique_ptr<SharedOptions> runtime_options_;
  std::unique_ptr<MapStore> map_;
  std::unique_ptr<OutputPublisher> publisher_;
  std::unique_ptr<MapOutput> map_output_;
  IncidentLog drops_;
  IncidentLog path_doubts_;  ///< paths that were used and should be looked at
  std::atomic<bool> paused_{false};
  std::atomic<uint64_t> matched_{0};

  std::mutex delivery_mutex_;
  /// Spent in a blocking queue: while it blocks no cloud can come in, so the clock of the wait for clouds stands still.
  double blocked_s_ = 0;
  mutable std::mutex intake_mutex_;
  std::unique_ptr<TfLookup> tf_;  ///< null where nothing is looked up
  std::unique_ptr<KeyframeIntake> intake_;

  std::mutex path_mutex_;
  std::string path_frame_;  ///< the world frame of the newest keyframe

  KeyframeNumbers numbers_;
  std::unique_ptr<ShardExchange> exchange_;  ///< null without other shards
  std::unique_ptr<MapperWorker> worker_;
  ros::WallTimer deliver_timer_;
  std::unique_ptr<MasterWatch> master_watch_;
  std::vector<std::unique_ptr<InputSource>> sources_;
  ros::Subscriber optimized_path_;
  std::unique_ptr<MapperServices> services_;
  boost::recursive_mutex config_mutex_;
  std::unique_ptr<dynamic_reconfigure::Server<DenseMapperConfig>> reconfigure_;
  std::unique_ptr<MapperDiagnostics> diagnostics_;
};

}  // namespace acmp
