#pragma once

#include <optional>
#include <vector>

#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

/// Depth range of a frame of which no landmarks are known: corners are looked for in other frames along their rays, and
/// the depths found give the range as those of landmarks do (DepthRangeFromLandmarks). None while too few are found, or
/// while most of them hardly move between the frames: the camera has not moved sideways far enough.
///
/// Tries the first of the others, then the first two, four and eight: what is near the camera is seen only by those
/// that are near as well.
/// @param others nearest first; at most 8 are of use; their poses are the received ones
std::optional<DepthRange> DepthRangeFromMatches(const Frame& frame, const std::vector<FramePtr>& others,
                                                const DepthRangeOptions& options);

}  // namespace acmp
