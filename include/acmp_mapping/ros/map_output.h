#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>

#include <acmp_mapping/SaveMap.h>
#include <ros/node_handle.h>

#include "acmp_mapping/map/map_store.h"

namespace acmp {

/// The topic map_points (latched) and the file of save_map. SetHeader may be called in any thread, the rest belongs to
/// one.
class MapOutput {
 public:
  /// @param map outlives this
  /// @param save_folder of Save, see MapPathBelow
  MapOutput(ros::NodeHandle nh, const MapStore* map, const std::string& save_folder);

  /// Of the newest keyframe in the map. Nothing is published before the first.
  void SetHeader(const std::string& world_frame, int64_t stamp_ns);

  /// Returns the number of points. Throws InvalidInputError for a map of more than 1 GB: roscpp's subscribers hang up
  /// on such messages.
  size_t Publish();
  /// Publishes when somebody listens, the map or the listeners have changed, and the last time is long enough ago.
  /// @param max_rate Hz; 0: never
  void PublishIfDue(double max_rate);

  /// Writes the map to a file below save_folder. Throws InvalidInputError, ProcessingError (see MapPathBelow,
  /// WriteMap).
  acmp_mapping::SaveMap::Response Save(const acmp_mapping::SaveMap::Request& request) const;

 private:
  const MapStore* const map_;
  const std::string save_folder_;
  std::mutex header_mutex_;  ///< guards the next two
  std::string world_frame_;
  int64_t stamp_ns_ = 0;
  uint64_t published_version_ = 0;
  double next_publish_s_ = 0;
  std::atomic<bool> requested_{false};  ///< a new subscriber: publish even if nothing has changed
  ros::Publisher publisher_;
};

}  // namespace acmp
