#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <acmp_mapping/KeyframePoints.h>
#include <nav_msgs/Path.h>

#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/map/loop_correction.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/keyframe_outputs.h"

/// The messages that the map takes: of mappers, and of loop closures. No master is needed.
namespace acmp {

/// What a message says, beside its points.
struct KeyframePointsHead {
  KeyframeKey key;
  KeyframePose pose;
  std::string world_frame;
};

/// All of a message but count, replaces, images_under_way and image.
acmp_mapping::KeyframePointsPtr ToKeyframePoints(const KeyframePointsHead& head, const PointCloud& points_in_camera);
/// All but the count. @param mapper name of the mapper's node
acmp_mapping::KeyframePointsPtr ToKeyframePoints(const KeyframeOutput& output, const std::string& mapper,
                                                 bool replaces);

/// Puts a JPEG file into a message that has all but that.
void FillImage(std::string_view jpeg, acmp_mapping::KeyframePoints* message);
/// The image of a message that ReadHead takes, or none. Throws as ImageStore::Put.
StoredImagePtr StoreImage(const acmp_mapping::KeyframePoints& message, ImageStore* images);

/// For messages to people: its number and mapper, of whose name, which may be of any length, the beginning.
std::string NameOf(const acmp_mapping::KeyframePoints& message);

/// Throws InvalidInputError naming what cannot be used: no name of a mapper, no rigid transform, a bad tolerance,
/// no camera, or one whose images in a session would take more than max_bytes.
KeyframePointsHead ReadHead(const acmp_mapping::KeyframePoints& message, size_t max_bytes = kMemoryLimitBytes);

/// What could be used of a message.
struct OptimizedPath {
  std::vector<StampedPose> poses;  ///< as received
  size_t in_other_frame = 0;       ///< of these, poses whose frame is not the expected one
  std::string other_frame;         ///< of the first of these
};

/// @param path_frame frame_id that the poses should have, without leading slash; empty = any
/// @param on_bad_pose told of every pose that is not finite or whose quaternion is off unit length by more than 1e-3
OptimizedPath ToOptimizedPath(const nav_msgs::Path& message, const std::string& path_frame,
                              const std::function<void(const RejectedInput&)>& on_bad_pose);

/// What a user should know of a path that was used; `message` is empty when all is well.
RejectedInput DescribeDoubt(const OptimizedPath& path, const ReposeResult& result, const std::string& path_frame);

/// What of a path was refused because it lies too far away; `message` is empty when nothing was.
RejectedInput DescribeTooFar(const ReposeResult& result);

}  // namespace acmp
