#pragma once

#include <map>
#include <optional>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"

namespace acmp {

/// Fuses the images of a chunk, in the order of their index, as if all images of the scene were fused one after the
/// other: which pixels earlier chunks have used comes from their files. Writes the points of each view, and last which
/// pixels are used now.
/// @param images with maps, whose final estimates and those of their source views are in files
/// @param fused_before see ChunkPlan; throws ProcessingError if one of these chunks is not fused
void FuseChunk(ReconstructRun* run, FrameStore* frames, int chunk, const std::vector<int>& images,
               const std::map<int, int>& fused_before);

/// Whether all files of FuseChunk are there and whole.
bool HasChunkPoints(const OutputFolder& folder, int chunk, const std::vector<int>& images);

/// A view's points; nothing where they are not there or damaged.
std::optional<PointCloud> ReadPointsOfView(const OutputFolder& folder, int index);

}  // namespace acmp
