#pragma once

#include "acmp_mapping/common/option.h"
#include "acmp_mapping/ros/map_store.h"
#include "acmp_mapping/ros/parameter_reader.h"

namespace acmp {

enum class TimeJumpPolicy {
  kClear,  ///< buffers and window are forgotten, the map is kept
  kReset,  ///< the map as well
};

/// What is read once when the map is made; MapServerOptionTable says what each means and what it may be.
struct MapServerOptions {
  MapStoreOptions map;
  TimeJumpPolicy on_time_jump = TimeJumpPolicy::kClear;
  double map_publish_rate = 0.5;  ///< Hz
};

const OptionTable<MapServerOptions>& MapServerOptionTable();

/// Throws InvalidInputError naming the parameter and what it may be.
MapServerOptions LoadMapServerOptions(ParameterReader* reader);

}  // namespace acmp
