#include "acmp_mapping/ros/optimized_path.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/intake/sensor_samples.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {

OptimizedPath ToOptimizedPath(const nav_msgs::Path& message, const std::string& path_frame,
                              const std::function<void(const Incident&)>& on_bad_pose) {
  OptimizedPath path;
  path.poses.reserve(message.poses.size());
  for (const geometry_msgs::PoseStamped& pose : message.poses) {
    try {
      path.poses.push_back({ToStampNs(pose.header.stamp), ToTransform(pose.pose)});
    } catch (const InvalidInputError& error) {
      on_bad_pose({"bad_optimized_pose", Concat("optimized_path, pose ", pose.header.stamp, ": ", error.what())});
      continue;
    }
    const std::string& named = pose.header.frame_id.empty() ? message.header.frame_id : pose.header.frame_id;
    const std::string frame = StripLeadingSlash(named);
    if (path_frame.empty() || frame.empty() || frame == path_frame) continue;
    if (path.in_other_frame++ == 0) path.other_frame = frame;
  }
  return path;
}

Incident DescribeDoubt(const OptimizedPath& path, const ReposeResult& result, const std::string& path_frame) {
  const auto to_ms = [](int64_t ns) { return static_cast<double>(ns) * 1e-6; };
  if (path.in_other_frame > 0) {
    return {"optimized_path_frame",
            Concat(path.in_other_frame, " of ", path.poses.size(), " poses of optimized_path are in \"",
                   path.other_frame, "\", the map is in \"", path_frame,
                   "\": taken as if they were in the map's; set ~world_frame of the mapper if both are the same")};
  }
  if (result.unresolved > 0) {
    return {"optimized_path_extrinsic",
            Concat(result.unresolved,
                   " keyframes are not corrected by optimized_path: their mapper did not know "
                   "T_body_cam, which ~path_child = body needs")};
  }
  if (result.named == 0 && result.too_far == 0 && result.nearest) {
    return {"optimized_path_unmatched",
            Concat("none of the ", path.poses.size(), " poses of optimized_path has the stamp of a keyframe within ",
                   to_ms(result.nearest->tolerance_ns), " ms (~sync_tolerance of the mapper); the nearest is ",
                   to_ms(result.nearest->gap_ns), " ms away: each pose needs the stamp of its own image")};
  }
  return {};
}

Incident DescribeTooFar(const ReposeResult& result) {
  if (!result.first_too_far) return {};
  const ReposeResult::TooFar& first = *result.first_too_far;
  return {"optimized_path_too_far",
          Concat("keyframes not moved by optimized_path: ", result.too_far, "; the first would go by pose ",
                 FormatStamp(first.stamp_ns), " to (", first.position.x(), ", ", first.position.y(), ", ",
                 first.position.z(), "): must lie within ", first.allowed.max_distance, " of (",
                 first.allowed.origin.x(), ", ", first.allowed.origin.y(), ", ", first.allowed.origin.z(),
                 ") with its points (", kMaxMapVoxels, " voxels)")};
}

}  // namespace acmp
