#pragma once

#include <functional>
#include <mutex>

#include <ros/node_handle.h>
#include <std_msgs/Header.h>

#include "acmp_mapping/map/live_mesh.h"
#include "acmp_mapping/ros/map_output.h"
#include "acmp_mapping/ros/options.h"

namespace acmp {

/// The topic mesh (visualization_msgs/MarkerArray): what has changed of the map's mesh, each block of space as a
/// TRIANGLE_LIST whose id stays the same, DELETE where it has gone, DELETEALL where all has. A new listener gets all
/// blocks (and so do the others once more), in as many messages as that takes. When nothing waits, what was told once
/// is told again, slowly, for listeners who were too slow and have lost messages. Nothing is computed, nor held in
/// memory, while nobody listens; with mesh_rate 0 there is no such topic.
class MeshOutput {
 public:
  /// @param map and map_output outlive this
  /// @param report told what is less than it should be; in the thread of PublishIfDue
  MeshOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options, MapOutput* map_output,
             std::function<void(const RejectedInput&)> report);

  /// Publishes the next changes when it is time to. In a thread of its own, often.
  void PublishIfDue();

  LiveMeshStatistics statistics() const;  ///< any thread
  uint32_t listeners() const { return publisher_.getNumSubscribers(); }

 private:
  /// Whether there is something to publish now.
  bool HasWork(bool make_again);
  void Publish(const MeshUpdate& update, std_msgs::Header header);
  void PublishNothing();
  /// Whether it is time to tell again what was told once.
  bool MayRepeat();

  const MapServerOptions options_;
  MapOutput* const map_output_;
  const std::function<void(const RejectedInput&)> report_;
  LiveMesh mesh_;
  bool is_listened_to_ = false;
  PublishPace pace_, again_pace_, repeat_pace_;
  std_msgs::Header header_;  ///< of the last blocks; no frame: none were published
  bool is_new_listener_ = false;
  bool deleted_once_ = false;  ///< all markers have been deleted, which is to be told once more
  bool deletes_ = false;       ///< the next message does so
  mutable std::mutex statistics_mutex_;
  LiveMeshStatistics statistics_;  ///< guarded by it
  ros::Publisher publisher_;       ///< last: its callbacks use what is above
};

}  // namespace acmp
