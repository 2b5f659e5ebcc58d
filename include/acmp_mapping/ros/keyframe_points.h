#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <acmp_mapping/KeyframePoints.h>

#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/keyframe_outputs.h"

/// The message between mappers and the map; no master is needed.
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

}  // namespace acmp
