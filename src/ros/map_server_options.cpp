#include "acmp_mapping/ros/map_server_options.h"

#include <string>

#include "acmp_mapping/common/error.h"

namespace acmp {

MapServerOptions LoadMapServerOptions(ParameterReader* reader) {
  MapServerOptions options;
  reader->Read("max_keyframes", &options.map.max_keyframes);
  reader->Read("map_radius", &options.map.map_radius);
  reader->Read("voxel_size", &options.map.voxel_size);
  Validate(options.map);
  std::string on_time_jump = "keep";
  reader->Read("on_time_jump", &on_time_jump);
  if (on_time_jump != "keep" && on_time_jump != "reset") {
    throw InvalidInputError(Concat("parameter ~on_time_jump = \"", on_time_jump, "\": must be one of keep, reset"));
  }
  options.map.keep_earlier_runs = on_time_jump == "keep";
  reader->Read("map_publish_rate", &options.map_publish_rate);
  CheckRange("parameter ~map_publish_rate", options.map_publish_rate, 0.0, 30.0);
  return options;
}

}  // namespace acmp
