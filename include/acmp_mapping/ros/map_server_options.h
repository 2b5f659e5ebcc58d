#pragma once

#include <string>

#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/common/option.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/parameter_reader.h"

namespace acmp {

/// What is read once when the map server is loaded; MapServerOptionTable says what each means and what it may be. What
/// poses mean comes with the keyframes.
struct MapServerOptions {
  MapStoreOptions map;
  double map_publish_rate = 0.5;      ///< Hz
  double occupancy_min_height = 0.1;  ///< of the topic occupancy: z in the world
  double occupancy_max_height = 1;
  double memory_limit_gb = kMemoryLimitGb;  ///< of a message or a file while it is worked on
  std::string save_folder;                  ///< save_map and sessions: only below it; never empty once loaded
  std::string load_session;                 ///< loaded at start; empty: none

  size_t memory_limit_bytes() const { return static_cast<size_t>(memory_limit_gb * 1e9); }
};

const OptionTable<MapServerOptions>& MapServerOptionTable();

/// Throws InvalidInputError naming the parameter and what it may be.
MapServerOptions LoadMapServerOptions(ParameterReader* reader);

}  // namespace acmp
