#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include <acmp_mapping/SaveMap.h>
#include <ros/node_handle.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/map_server_options.h"
#include "acmp_mapping/ros/publish_pace.h"

namespace acmp {

/// The topics map_points and occupancy (latched) and the file of save_map. SetHeader may be called in any thread, the
/// rest belongs to one.
class MapOutput {
 public:
  /// @param map outlives this
  MapOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options);

  /// Of the newest keyframe in the map. Nothing is published before the first.
  void SetHeader(const std::string& world_frame, int64_t stamp_ns);
  std_msgs::Header Header();

  /// Far from the world's origin (kNearVoxels), where float32 does not hold them, the points are in a frame of their
  /// own with the world's axes, WORLD_FRAME + kLocalFrameSuffix, which tf has then. Returns the number of points.
  /// Throws InvalidInputError for a map of more than 1 GB: roscpp's subscribers hang up on such messages.
  size_t Publish();
  /// When the map has been emptied: an empty cloud and grid in place of what is latched, and no header.
  void PublishNothing();
  /// Publishes what PublishPace says, at options.map_publish_rate.
  void PublishIfDue();

  /// Writes the map to a file below save_folder. Throws InvalidInputError, ProcessingError (see MapPathBelow, WriteMap,
  /// MakeMapMesh, OccupancyMap).
  acmp_mapping::SaveMap::Response Save(const acmp_mapping::SaveMap::Request& request) const;

 private:
  using SaveMap = acmp_mapping::SaveMap;

  static constexpr const char* kLocalFrameSuffix = "_map_origin";

  /// Unless the origin is zero, makes the header that of local coordinates.
  void EnterLocalFrame(const Eigen::Vector3d& origin, std_msgs::Header* header);
  void PublishOccupancy();
  size_t SaveMesh(const std::filesystem::path& path, const SaveMap::Request& request, size_t* keyframes) const;

  const MapStore* const map_;
  const MapServerOptions options_;
  std::mutex header_mutex_;  ///< guards the next two
  std::string world_frame_;
  int64_t stamp_ns_ = 0;
  PublishPace points_pace_, occupancy_pace_;
  ros::Publisher points_, occupancy_;
  std::unique_ptr<tf2_ros::StaticTransformBroadcaster> local_frame_;  ///< none before it is needed
};

}  // namespace acmp
