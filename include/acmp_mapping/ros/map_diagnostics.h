#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <diagnostic_updater/diagnostic_updater.h>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/incident_log.h"

namespace acmp {

/// What has come from one mapper since the map was last emptied.
struct MapperTraffic {
  uint64_t received = 0;  ///< messages
  uint64_t lost = 0;      ///< messages on the way
  double last_received_s = 0;
  uint64_t images_under_way = 0;  ///< not finished when it sent its last message
};

/// Everything the map server's diagnostics are made of, taken at one moment.
struct MapSnapshot {
  double now_s = 0;  ///< steady clock, as of all the times below
  MapStatistics map;
  std::string optimized_path_topic;
  uint32_t optimized_path_publishers = 0;
  std::string keyframe_topic;
  uint32_t keyframe_publishers = 0;
  std::map<std::string, MapperTraffic> mappers;  ///< by name
  std::map<std::string, IncidentLog::Entry> incidents;
};

/// What of the images is not in the map: for each mapper how many messages of points were lost on the way, and how many
/// images were under way when its last one was sent; empty when there is nothing.
std::string DescribeMissing(const std::map<std::string, MapperTraffic>& mappers);

/// One status each, without a master: "map" and "mappers".
void DescribeMap(const MapSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);
void DescribeMappers(const MapSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);

}  // namespace acmp
