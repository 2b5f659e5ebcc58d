#pragma once

#include <cstdint>
#include <string>

#include <acmp_mapping/KeyframePoints.h>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/keyframe_outputs.h"

/// The message between mappers and the map; no master is needed.
namespace acmp {

/// What a message says, beside its points.
struct KeyframePointsHead {
  KeyframeKey key;
  KeyframePose pose;
  std::string world_frame;
  std::string path_frame;  ///< frame_id of the poses of optimized_path; empty: any
};

/// All but the count. @param mapper name of the mapper's node
acmp_mapping::KeyframePointsPtr ToKeyframePoints(const KeyframeOutput& output, const std::string& mapper,
                                                 bool replaces);

/// Throws InvalidInputError naming what cannot be used: no name of a mapper, no rigid transform, a bad tolerance.
KeyframePointsHead ReadHead(const acmp_mapping::KeyframePoints& message);

}  // namespace acmp
