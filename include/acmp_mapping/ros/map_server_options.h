#pragma once

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/parameter_reader.h"

namespace acmp {

/// Private parameters of the map server, read once when it is loaded. What poses mean comes with the keyframes.
struct MapServerOptions {
  MapStoreOptions map;            ///< max_keyframes, voxel_size, map_radius, on_time_jump: keep or reset
  double map_publish_rate = 0.5;  ///< map_publish_rate: map_points at most so often, 0..30 Hz; 0 = on request
};

/// Throws InvalidInputError naming the parameter and what it may be.
MapServerOptions LoadMapServerOptions(ParameterReader* reader);

}  // namespace acmp
