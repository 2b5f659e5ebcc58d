#pragma once

#include <filesystem>

#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// Whether a path is that of a cloud in tiles: a folder with index.json, or that file.
bool IsTiledCloud(const std::filesystem::path& path);

/// All points of a cloud in tiles, tile by tile in the order of index.json, which acmp_reconstruct --tile-size writes.
/// Throws InvalidInputError for an index that cannot be read, and a tile that is missing, damaged or has another number
/// of points.
PointCloud ReadTiledCloud(const std::filesystem::path& path);

}  // namespace acmp
