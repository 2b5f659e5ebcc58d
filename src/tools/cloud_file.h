#pragma once

#include <filesystem>
#include <ostream>

#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// Positions of a cloud: of a .pcd by PCL (ASCII, binary or compressed), else ReadPly. PCD has NaN where an organised
/// cloud has no point: such points are left out, and `notes` says how many. Throws InvalidInputError for files that
/// cannot be read, have no float x, y, z, or are .pcd where this was built without PCL.
PointCloud ReadCloudFile(const std::filesystem::path& path, std::ostream* notes);

}  // namespace acmp
