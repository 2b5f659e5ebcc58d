#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include <acmp_mapping/SaveMap.h>
#include <ros/node_handle.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/map/occupancy_map.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/label_file.h"
#include "acmp_mapping/ros/options.h"

namespace acmp {

/// When something that is made of the map is to be published: when somebody listens, the map or the listeners have
/// changed, and the last time is long enough ago. Request may be called in any thread, the rest belongs to one.
class PublishPace {
 public:
  /// A new listener: publish even if nothing has changed.
  void Request() { requested_ = true; }

  /// @param max_rate Hz; 0: never
  bool IsDue(double max_rate, uint32_t listeners, uint64_t map_version) const {
    return max_rate > 0 && listeners > 0 && IsTime() && (map_version != published_version_ || requested_);
  }
  /// The last time is long enough ago.
  bool IsTime() const { return SteadySeconds() >= next_s_; }

  /// First, before the map is read, also where nothing comes of it.
  void Begin(uint64_t map_version = 0) {
    begun_s_ = SteadySeconds();
    requested_ = false;
    published_version_ = map_version;
  }

  /// When it has been published, or failed.
  /// @param max_share of the time that the work may take
  void End(double max_rate, double max_share = kMaxShare) {
    next_s_ = std::max(begun_s_ + 1 / max_rate, begun_s_ + (SteadySeconds() - begun_s_) / max_share);
  }

 private:
  static constexpr double kMaxShare = 0.2;

  std::atomic<bool> requested_{false};
  uint64_t published_version_ = 0;
  double begun_s_ = 0, next_s_ = 0;
};

/// The frame of coordinates that begin there: WORLD_FRAME_map_origin_X_Y_Z. Of another origin it is another frame, so
/// that clouds that somebody holds, and those of other maps, stay where they are.
std::string LocalFrame(const std::string& world_frame, const Eigen::Vector3d& origin);

/// Advertises a latched topic of what is made of the whole map.
template <class Message>
ros::Publisher AdvertiseLatched(ros::NodeHandle* nh, const char* name, PublishPace* pace) {
  const ros::SubscriberStatusCallback on_connect = [pace](const ros::SingleSubscriberPublisher&) { pace->Request(); };
  return nh->advertise<Message>(name, 1, on_connect, ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
}

/// The topics map_points and map_labels (latched) and the file of save_map. SetHeader and PublishNothing may be called
/// in any thread, the rest belongs to one.
class MapOutput {
 public:
  /// Throws InvalidInputError as LabelTable does.
  /// @param map outlives this
  /// @param report told why a topic is not published, and what is less than it should be; any thread
  MapOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options,
            std::function<void(const RejectedInput&)> report);

  /// Any thread: soon ends what takes long. Nothing is published or saved afterwards.
  void Stop() { stopping_ = true; }
  /// Throws ProcessingError after Stop.
  void CheckStopped() const;

  /// Of the newest keyframe in the map. Nothing is published before the first.
  void SetHeader(const std::string& world_frame, int64_t stamp_ns);
  std_msgs::Header Header();
  /// Unless the origin is zero, makes the header that of local coordinates (LocalFrame), which tf has then. Any thread.
  void EnterLocalFrame(const Eigen::Vector3d& origin, std_msgs::Header* header);

  /// Far from the world's origin (kNearVoxels), where float32 does not hold them, the points are in a frame of their
  /// own with the world's axes, LocalFrame, which tf has then. Returns the number of points.
  /// Throws InvalidInputError for a map of more than 1 GB: roscpp's subscribers hang up on such messages.
  size_t Publish();
  /// When the map has been emptied: an empty cloud in place of what is latched, and no header. Any thread;
  /// what another one is about to publish of the map that was is not published any more.
  void PublishNothing();
  /// Publishes when PublishPace says so, at options.map_publish_rate.
  void PublishIfDue();

  /// By memory_limit and label_file; ends with Stop.
  OccupancyLimits LimitsOfOccupancy() const;
  /// How much coarser than it should be an occupancy map is; empty where it is not.
  std::string DescribeCoarse(const OccupancyMap& occupancy, double voxel_size) const;

  /// Writes the map to a file below save_folder. Throws InvalidInputError, ProcessingError (see MapPathBelow, WriteMap,
  /// MakeMapMesh, OccupancyMap).
  acmp_mapping::SaveMap::Response Save(const acmp_mapping::SaveMap::Request& request) const;

 private:
  const MapStore* const map_;
  const MapServerOptions options_;
  const std::function<void(const RejectedInput&)> report_;
  std::atomic<bool> stopping_{false};
  std::mutex header_mutex_;  ///< held for a moment only, as every keyframe takes it
  std_msgs::Header header_;
  std::mutex local_frame_mutex_;  ///< guards what follows, while the first asks the master
  std::string local_frame_name_;  ///< as tf has it
  std::unique_ptr<tf2_ros::StaticTransformBroadcaster> local_frame_;  ///< none before it is needed
  std::mutex publish_mutex_;                                          ///< held while a message is handed to roscpp
  std::atomic<uint64_t> emptied_{0};                                  ///< how often; changes with publish_mutex_ held
  const LabelTable label_table_;
  PublishPace points_pace_;
  ros::Publisher points_;
  ros::Publisher labels_;  ///< the points in the colours of their classes, while somebody listens
};

}  // namespace acmp
