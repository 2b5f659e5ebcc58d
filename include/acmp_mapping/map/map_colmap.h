#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>

#include "acmp_mapping/map/map_store.h"

namespace acmp {

/// What WriteColmapFolder has written, and what not.
struct ColmapFolder {
  size_t images = 0;          ///< keyframes that are in the model
  size_t points = 0;          ///< of the cloud; those that no image sees are left out
  size_t without_image = 0;   ///< keyframes that are not in it: no image was kept
  size_t without_points = 0;  ///< the same: the map has nothing of them, as their poses did not fit
};

/// Throws InvalidInputError unless a folder can be written there: what has that name must be a folder with a COLMAP
/// model, as this writes it, and nothing else, as other programs' results.
void CheckColmapFolder(const std::filesystem::path& path);

/// Writes the keyframes that have an image as a COLMAP model, which splat trainers, nerfstudio, OpenMVS and COLMAP
/// read: images/SECONDS_NANOSECONDS_MAPPER.jpg, sparse/0/*.bin (WriteColmapModel) with the poses in use and at most
/// ColmapPoints::kMaxPoints points of the map. Coordinates are the map's local ones. The folder appears under its name
/// only when it is whole and on the disk, in place of an earlier one. Throws InvalidInputError for an empty map, one
/// without images, and a path as CheckColmapFolder does, ProcessingError with the system's reason when writing fails.
/// @param check called before each keyframe; what it throws ends the work
ColmapFolder WriteColmapFolder(
    const std::filesystem::path& path, const PlacedKeyframes& map, const std::function<void()>& check = [] {});

}  // namespace acmp
