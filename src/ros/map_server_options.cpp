#include "acmp_mapping/ros/map_server_options.h"

#include <cstdlib>
#include <filesystem>
#include <string>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {

const OptionTable<MapServerOptions>& MapServerOptionTable() {
  static const OptionTable<MapServerOptions> table = [] {
    OptionTable<MapServerOptions> made;
    made.Group("map");
    made.Add(
        Number("max_keyframes", 1, 1000000, "",
               "Keyframes kept in the map, of all mappers together; the oldest go first"),
        [](auto& o) -> auto& { return o.map.max_keyframes; });
    made.Add(
        Number("map_radius", 0, 1e9, "(unit of the poses)",
               "Keyframes farther than this from the newest one of every mapper leave the map; 0: no limit"),
        [](auto& o) -> auto& { return o.map.map_radius; });
    made.Add(
        Number("voxel_size", 0, 1e6, "(unit of the poses)",
               "The map has one point per cube of this size; 0: 0.5 % of the first keyframe's median depth"),
        [](auto& o) -> auto& { return o.map.voxel_size; });
    made.Add(
        Choice("on_time_jump", {"keep", "reset"},
               "When a mapper's images go back in time, as in a bag that is played again, it was restarted, or its "
               "frontend "
               "went on in another world: keep its earlier keyframes, or forget them"),
        [](const MapServerOptions& o) { return OptionValue(std::string(o.map.keep_earlier_runs ? "keep" : "reset")); },
        [](const OptionValue& value, MapServerOptions* o) {
          o->map.keep_earlier_runs = std::get<std::string>(value) == "keep";
        });
    made.Add(
        Number("map_publish_rate", 0, 30, "Hz",
               "The map is published at most so often; 0: only when the service publish_map is called"),
        [](auto& o) -> auto& { return o.map_publish_rate; });
    made.Add(
        Number(
            "occupancy_min_height", -1e6, 1e6, "(unit of the poses)",
            "The topic occupancy tells what is between two heights (z of the world frame, which must be upwards): this "
            "is the lower one, above the floor"),
        [](auto& o) -> auto& { return o.occupancy_min_height; });
    made.Add(
        Number("occupancy_max_height", -1e6, 1e6, "(unit of the poses)", "The upper one: the height of the robot"),
        [](auto& o) -> auto& { return o.occupancy_max_height; });
    made.Add(
        Number("memory_limit", 0.01, 1000, "GB",
               "What one keyframe or session may take while it is saved, loaded or published: more is refused before "
               "memory "
               "is asked for, and occupancy gets larger cells"),
        [](auto& o) -> auto& { return o.memory_limit_gb; });
    made.Add(
        Text("save_folder",
             "Maps and sessions are saved and loaded only below this folder, where relative paths start; empty: "
             "~/.ros/acmp_mapping (in ROS_HOME where that is set), which is made; /: anywhere"),
        [](auto& o) -> auto& { return o.save_folder; });
    made.Add(
        Text("load_session", "Session (save_session) to begin with, in place of an empty map; empty: none"),
        [](auto& o) -> auto& { return o.load_session; });
    return made;
  }();
  return table;
}

namespace {

/// Not the folder that the node was started in, which may be the home: whoever reaches the ROS master may save there.
std::string MakeDefaultFolder() {
  const char* ros_home = std::getenv("ROS_HOME");
  const char* home = std::getenv("HOME");
  if (!ros_home && !home) {
    throw InvalidInputError("parameter ~save_folder is empty, and neither HOME nor ROS_HOME is set: must be a folder");
  }
  const auto folder =
      (ros_home ? std::filesystem::path(ros_home) : std::filesystem::path(home) / ".ros") / "acmp_mapping";
  MakeFolder(folder);
  return folder.string();
}

}  // namespace

MapServerOptions LoadMapServerOptions(ParameterReader* reader) {
  MapServerOptions options;
  ReadOptions(MapServerOptionTable(), reader, &options);
  Validate(options.map);
  if (!(options.occupancy_min_height < options.occupancy_max_height)) {
    throw InvalidInputError(Concat("parameter ~occupancy_min_height = ", options.occupancy_min_height,
                                   ": must be below ~occupancy_max_height = ", options.occupancy_max_height));
  }
  if (options.save_folder.empty()) options.save_folder = MakeDefaultFolder();
  if (!std::filesystem::is_directory(options.save_folder)) {
    throw InvalidInputError(
        Concat("parameter ~save_folder = \"", options.save_folder, "\": must be a folder (without ~)"));
  }
  return options;
}

}  // namespace acmp
