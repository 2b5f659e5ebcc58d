#include "acmp_mapping/ros/map_diagnostics.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;

constexpr double kRecentIncidentS = 5;  ///< incidents that young are worth a word

}  // namespace

std::string DescribeMissing(const std::map<std::string, MapperTraffic>& mappers) {
  std::string text;
  for (const auto& [name, mapper] : mappers) {
    if (mapper.lost > 0) {
      text += Concat("; ", mapper.lost, " messages with points of ", name,
                     " were lost on the way, as the map server did not read them in time or the connection was cut");
    }
    if (mapper.images_under_way == 0) continue;
    text += Concat("; ", mapper.images_under_way, " images were still under way in ", name,
                   " when its last points came: its service flush finishes them, if it has not since");
  }
  return text;
}

void DescribeMap(const MapSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  const MapStatistics& map = snapshot.map;
  status->summary(DiagnosticStatus::OK, Concat(map.keyframes, " keyframes in the map"));
  status->add("keyframes", map.keyframes);
  status->add("points held", map.points);
  status->add("keyframes that got better points", map.replaced);
  status->add("better points of keyframes that were not in the map", map.not_replaced);
  status->add("keyframes evicted (~max_keyframes)", map.evicted);
  status->add("keyframes evicted (~map_radius)", map.evicted_by_radius);
  status->add("points that later keyframes looked through", map.looked_through);
  status->add("keyframes that have yet to look through the points of others", map.yet_to_look);
  status->add("keyframes that were evicted before they looked", map.never_looked);
  status->add("keyframes evicted (~on_time_jump)", map.evicted_by_run);
  status->add("images kept (~keep_images of the mappers)",
              Concat(map.images, ", ", map.image_bytes / 1000000, " MB",
                     map.image_stride > 1 ? Concat("; of one keyframe in ", map.image_stride,
                                                   ", as they would take over half of the free disk")
                                          : ""));
  status->add("voxel size [unit of the poses]", map.voxel_size);
  status->add("optimized paths", Concat(map.paths, " received on ", snapshot.optimized_path_topic, " (",
                                        snapshot.optimized_path_publishers, " publisher(s))"));
  status->add("loop corrections (paths that moved keyframes)", map.corrections);
  status->add("keyframes re-posed, all corrections together", map.reposed);
  status->add("scales of keyframes by optimized paths", Concat(map.smallest_scale, " to ", map.largest_scale));
  status->add("poses of the last optimized path without a keyframe",
              Concat(map.path_unmatched, " of ", map.path_poses));
  status->add("keyframes that the last optimized path would put too far away", map.path_too_far);
  if (map.path_too_far > 0) {
    status->mergeSummary(DiagnosticStatus::WARN,
                         Concat(map.path_too_far, " keyframes stay where they are: by the last optimized path they ",
                                "would go farther than 2^30 voxels of size ", map.voxel_size, " from the origin"));
  }
  for (const auto& [reason, entry] : snapshot.incidents) {
    const std::string text = Concat(entry.count, " (", entry.last_message, ")");
    status->add("incident: " + reason, text);
    if (snapshot.now_s - entry.last_time_s <= kRecentIncidentS) status->mergeSummary(DiagnosticStatus::WARN, text);
  }
}

void DescribeMappers(const MapSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  status->summary(DiagnosticStatus::OK, Concat("keyframes of ", snapshot.mappers.size(), " mapper(s)"));
  status->add("publishers of " + snapshot.keyframe_topic, snapshot.keyframe_publishers);
  if (snapshot.keyframe_publishers == 0) {
    status->mergeSummary(DiagnosticStatus::WARN,
                         Concat("nobody publishes ", snapshot.keyframe_topic, ": is a mapper running?"));
  }
  for (const auto& [name, mapper] : snapshot.mappers) {
    const long silent_s = std::lround(std::max(0.0, snapshot.now_s - mapper.last_received_s));
    status->add(name, Concat(mapper.received, " messages, the last ", silent_s, " s ago; ", mapper.lost,
                             " lost; images under way then: ", mapper.images_under_way));
  }
}

}  // namespace acmp
