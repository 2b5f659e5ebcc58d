#pragma once

#include <filesystem>

#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

enum class MapFormat { kPly, kPcd };

/// Writes x y z, normal, colour and confidence of each point. The file appears under its name only when it is whole and
/// on the disk. Throws InvalidInputError for an empty map or a path that cannot be one, ProcessingError with the
/// system's reason when writing fails.
void WriteMap(const std::filesystem::path& path, const PointCloud& map, MapFormat format, bool binary);

}  // namespace acmp
