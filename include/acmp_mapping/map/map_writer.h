#pragma once

#include <filesystem>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// The whole path of a file for the map that must lie below a folder. A relative path starts at the folder; links and
/// .. are followed before the comparison. Throws InvalidInputError when the path names no file, begins with ~ (which a
/// shell expands, and nobody here), lies elsewhere or in a folder that does not exist.
std::filesystem::path MapPathBelow(const std::filesystem::path& folder, const std::filesystem::path& path);

/// Throws InvalidInputError for a name with another ending than `ending` (".ply"); one without an ending may be given.
/// @param format for the message: what is written
/// @param other for the message: another way out
void CheckEnding(const std::filesystem::path& path, const std::string& ending, const std::string& format,
                 const std::string& other = "");

/// For messages about a file that was there before.
constexpr char kReplaced[] = ", in place of the file of that name";

enum class MapFormat { kPly, kPcd };

/// Writes x y z, normal, colour and confidence of each point. The file appears under its name only when it is whole and
/// on the disk. Throws InvalidInputError for an empty map or a path that cannot be one, ProcessingError with the
/// system's reason when writing fails.
void WriteMap(const std::filesystem::path& path, const PointCloud& map, MapFormat format, bool binary);
/// The same of a mesh: throws for one without triangles.
void WriteMap(const std::filesystem::path& path, const TriangleMesh& map, MeshFormat format);
/// The path check of these. Throws InvalidInputError for one that cannot be a file.
void CheckMapPath(const std::filesystem::path& path);

}  // namespace acmp
