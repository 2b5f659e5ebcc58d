#pragma once

#include <functional>
#include <string>
#include <vector>

#include <nav_msgs/Path.h>

#include "acmp_mapping/map/loop_correction.h"
#include "acmp_mapping/ros/incident_log.h"

namespace acmp {

/// What could be used of a message.
struct OptimizedPath {
  std::vector<StampedPose> poses;  ///< as received
  size_t in_other_frame = 0;       ///< of these, poses whose frame is not the expected one
  std::string other_frame;         ///< of the first of these
};

/// @param path_frame frame_id that the poses should have, without leading slash; empty = any
/// @param on_bad_pose told of every pose that is not finite or whose quaternion is off unit length by more than 1e-3
OptimizedPath ToOptimizedPath(const nav_msgs::Path& message, const std::string& path_frame,
                              const std::function<void(const Incident&)>& on_bad_pose);

/// What a user should know of a path that was used; `message` is empty when all is well.
Incident DescribeDoubt(const OptimizedPath& path, const ReposeResult& result, const std::string& path_frame);

/// What of a path was refused because it lies too far away; `message` is empty when nothing was.
Incident DescribeTooFar(const ReposeResult& result);

}  // namespace acmp
