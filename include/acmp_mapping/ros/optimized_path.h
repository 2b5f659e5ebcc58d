#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <nav_msgs/Path.h>

#include "acmp_mapping/ros/drop.h"
#include "acmp_mapping/ros/loop_correction.h"
#include "acmp_mapping/ros/map_store.h"

namespace acmp {

/// What could be used of a message.
struct OptimizedPath {
  std::vector<StampedPose> poses;
  size_t in_other_frame = 0;  ///< of these, poses whose frame is not the world's
  std::string other_frame;    ///< of the first of these
};

/// @param world_frame of the map, without leading slash; empty = not known or not to be compared
/// @param world_from_camera the optical frame's pose for one as received, as for the pose input
/// @param on_drop told of every pose that is not finite or whose quaternion is off unit length by more than 1e-3
OptimizedPath ToOptimizedPath(const nav_msgs::Path& message, const std::string& world_frame,
                              const std::function<RigidTransform(const RigidTransform&)>& world_from_camera,
                              const std::function<void(const Drop&)>& on_drop);

/// How far the stamps of path and image may be apart: sync_tolerance, and at least 1 us, since stamps that went through
/// a double are up to 119 ns off, and some are cut to microseconds.
int64_t PathToleranceNs(double sync_tolerance_s);

/// What a user should know of a path that was used; `message` is empty when all is well.
Drop DescribeDoubt(const OptimizedPath& path, const ReposeResult& result, const std::string& world_frame,
                   int64_t tolerance_ns);

/// Corrects the map by a path. Poses that cannot be used go to on_drop, what a user should know of the path to
/// on_doubt. Returns whether keyframes were moved. See ToOptimizedPath for the other parameters.
bool ApplyOptimizedPath(const nav_msgs::Path& message, const std::string& world_frame,
                        const std::function<RigidTransform(const RigidTransform&)>& world_from_camera,
                        double sync_tolerance_s, MapStore* map, const std::function<void(const Drop&)>& on_drop,
                        const std::function<void(const Drop&)>& on_doubt);

}  // namespace acmp
