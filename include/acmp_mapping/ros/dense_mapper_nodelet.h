#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <dynamic_reconfigure/server.h>
#include <nodelet/nodelet.h>

#include "acmp_mapping/ros/callback_thread.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/map_output.h"
#include "acmp_mapping/ros/mapper_diagnostics.h"
#include "acmp_mapping/ros/mapper_services.h"
#include "acmp_mapping/ros/mapper_worker.h"
#include "acmp_mapping/ros/output_publisher.h"
#include "acmp_mapping/ros/shard_exchange.h"
#include "acmp_mapping/ros/shared_options.h"

namespace acmp {

/// Wires topics, services and parameters to the mapper; see docs/ for all of them.
///
/// Threads: one for input callbacks, which only buffer; the worker, which matches and publishes keyframes; one for
/// services, which also publishes the map; one for diagnostics and dynamic_reconfigure; one for what other shards send.
///
/// Locks: delivery_mutex_ keeps "take from the intake, hand to the worker" in order and may be held while the worker's
/// queue blocks; intake_mutex_ guards the intake for a moment. Where both are needed delivery_mutex_ comes first. All
/// other locks are inside their classes, and none of those is held while another one is taken.
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

  void HandleImage(std::shared_ptr<const EncodedImage> image);
  /// Runs add(intake) and hands on what has become complete.
  template <class Add>
  void Receive(const Add& add);
  void HandleConfig(DenseMapperConfig& config);
  void HandlePeriod();

  /// Takes what the intake has ready and hands it on. `all`: without waiting for clouds.
  void Deliver(bool all = false);
  void Dispatch(IntakeEvent event);
  void ReportDrop(const Drop& drop);
  std::string Reset();
  MapperSnapshot TakeSnapshot();

  // First: what is attached to them goes before they do.
  CallbackThread input_thread_;
  CallbackThread service_thread_;
  CallbackThread status_thread_;
  CallbackThread exchange_thread_;

  NodeOptions options_;
  std::unique_ptr<SharedOptions> runtime_options_;
  std::unique_ptr<MapStore> map_;
  std::unique_ptr<OutputPublisher> publisher_;
  std::unique_ptr<MapOutput> map_output_;
  IncidentLog drops_;
  std::atomic<bool> paused_{false};
  std::atomic<uint64_t> matched_{0};

  std::mutex delivery_mutex_;
  /// Spent in a blocking queue: while it blocks no cloud can come in, so the clock of the wait for clouds stands still.
  double blocked_s_ = 0;
  mutable std::mutex intake_mutex_;
  std::unique_ptr<KeyframeIntake> intake_;

  KeyframeNumbers numbers_;
  std::unique_ptr<ShardExchange> exchange_;  ///< null without other shards
  std::unique_ptr<MapperWorker> worker_;
  ros::WallTimer deliver_timer_;
  std::unique_ptr<InputSource> image_source_, camera_info_source_, pose_source_, cloud_source_;
  std::unique_ptr<MapperServices> services_;
  boost::recursive_mutex config_mutex_;
  DenseMapperConfig config_;
  std::unique_ptr<dynamic_reconfigure::Server<DenseMapperConfig>> reconfigure_;
  std::unique_ptr<MapperDiagnostics> diagnostics_;
};

}  // namespace acmp
