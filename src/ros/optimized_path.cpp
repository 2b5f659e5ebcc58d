#include "acmp_mapping/ros/optimized_path.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/sensor_samples.h"

namespace acmp {
OptimizedPath ToOptimizedPath(const nav_msgs::Path& message, const std::string& world_frame,
                              const std::function<RigidTransform(const RigidTransform&)>& world_from_camera,
                              const std::function<void(const Drop&)>& on_drop) {
  OptimizedPath path;
  path.poses.reserve(message.poses.size());
  for (const geometry_msgs::PoseStamped& pose : message.poses) {
    const int64_t stamp_ns = ToStampNs(pose.header.stamp);
    try {
      path.poses.push_back({stamp_ns, world_from_camera(ToTransform(pose.pose))});
    } catch (const InvalidInputError& error) {
      on_drop({"bad_optimized_pose", Concat("optimized_path, pose ", FormatStamp(stamp_ns), ": ", error.what())});
      continue;
    }
    const std::string& named = pose.header.frame_id.empty() ? message.header.frame_id : pose.header.frame_id;
    const std::string frame = StripLeadingSlash(named);
    if (world_frame.empty() || frame.empty() || frame == world_frame) continue;
    if (path.in_other_frame++ == 0) path.other_frame = frame;
  }
  return path;
}

int64_t PathToleranceNs(double sync_tolerance_s) {
  return std::max<int64_t>(1000, std::llround(sync_tolerance_s * 1e9));
}

Drop DescribeDoubt(const OptimizedPath& path, const ReposeResult& result, const std::string& world_frame,
                   int64_t tolerance_ns) {
  if (path.in_other_frame > 0) {
    return {"optimized_path_frame",
            Concat(path.in_other_frame, " of ", path.poses.size(), " poses of optimized_path are in \"",
                   path.other_frame, "\", the map is in \"", world_frame,
                   "\": taken as if they were in the map's; set ~world_frame if both are the same")};
  }
  if (result.named == 0 && result.nearest_gap_ns) {
    return {"optimized_path_unmatched",
            Concat("none of the ", path.poses.size(), " poses of optimized_path has the stamp of a keyframe within ",
                   static_cast<double>(tolerance_ns) * 1e-6, " ms (~sync_tolerance); the nearest is ",
                   static_cast<double>(*result.nearest_gap_ns) * 1e-6,
                   " ms away: each pose needs the stamp of its own image")};
  }
  return {};
}

bool ApplyOptimizedPath(const nav_msgs::Path& message, const std::string& world_frame,
                        const std::function<RigidTransform(const RigidTransform&)>& world_from_camera,
                        double sync_tolerance_s, MapStore* map, const std::function<void(const Drop&)>& on_drop,
                        const std::function<void(const Drop&)>& on_doubt) {
  try {
    const OptimizedPath path = ToOptimizedPath(message, world_frame, world_from_camera, on_drop);
    const int64_t tolerance_ns = PathToleranceNs(sync_tolerance_s);
    const ReposeResult result = map->Repose(path.poses, tolerance_ns);
    const Drop doubt = DescribeDoubt(path, result, world_frame, tolerance_ns);
    if (!doubt.message.empty()) on_doubt(doubt);
    return !result.moved.empty();
  } catch (const std::exception& error) {  // a thrown exception would end the whole manager
    on_drop({"bad_optimized_path", Concat("optimized_path: ", error.what())});
    return false;
  }
}

}  // namespace acmp
