#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include <diagnostic_updater/diagnostic_updater.h>
#include <nav_msgs/Path.h>
#include <nodelet/nodelet.h>

#include "acmp_mapping/ros/callback_thread.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/keyframe_sequence.h"
#include "acmp_mapping/ros/map_output.h"
#include "acmp_mapping/ros/map_server_options.h"
#include "acmp_mapping/ros/node_options.h"
#include "acmp_mapping/ros/mapper_services.h"
#include "acmp_mapping/ros/master_watch.h"

namespace acmp {

/// Makes one map of the keyframes that several mappers share (shard_count > 1): the map that one mapper would make.
///
/// Threads: one for keyframes, one for services, which also publishes the map, one for diagnostics and optimized_path.
/// mutex_ guards the sequence and is held while keyframes go into the map, in their order.
class MapMergerNodelet : public nodelet::Nodelet {
 public:
  ~MapMergerNodelet() override;

 private:
  struct Shard {
    uint64_t mapped = 0, dropped = 0;
    double last_received_s = 0;
  };

  void onInit() override;
  void LoadOptions();
  void StartServices();
  void Receive(const acmp_mapping::KeyframePointsConstPtr& keyframe);
  /// Needs mutex_.
  void Take(const KeyframeSequence::Result& result);
  void AddToMap(const acmp_mapping::KeyframePoints& keyframe);
  void HandleOptimizedPath(const nav_msgs::Path& path);
  void GiveUp();
  void HandlePeriod();
  std::string Reset();
  void ReportDrop(const Drop& drop);
  void DescribeShards(diagnostic_updater::DiagnosticStatusWrapper* status);

  // First: what is attached to them goes before they do.
  CallbackThread input_thread_;
  CallbackThread service_thread_;
  CallbackThread status_thread_;

  MapServerOptions options_;
  NodeOptions poses_;
  std::unique_ptr<MapStore> map_;
  std::unique_ptr<MapOutput> map_output_;
  IncidentLog drops_;
  IncidentLog path_doubts_;  ///< paths that were used and should be looked at

  std::mutex mutex_;
  KeyframeSequence sequence_;
  std::map<int, Shard> shards_;
  int shard_count_ = 0;         ///< as the last keyframe said; 0: none has come
  double last_progress_s_ = 0;  ///< when a keyframe came last or none waited
  uint64_t newest_number_ = 0;  ///< of the last keyframe in the map
  int64_t newest_stamp_ns_ = 0;
  std::string world_frame_;  ///< of that keyframe

  ros::Subscriber subscriber_;
  ros::Subscriber optimized_path_;
  std::unique_ptr<MapperServices> services_;
  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer status_timer_;
  std::unique_ptr<MasterWatch> master_watch_;
};

}  // namespace acmp
