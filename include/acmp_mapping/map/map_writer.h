#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/map/map_mesh.h"
#include "acmp_mapping/map/map_store.h"

namespace acmp {

/// The whole path of a file that whoever reaches the ROS master may name, which must lie below a folder. A relative
/// path starts at the folder; links and .. are followed before the comparison. Throws InvalidInputError when the path
/// names no file, begins with ~ (which a shell expands, and nobody here), lies elsewhere, where it does not say whether
/// anything is there, or in a folder that does not exist; when a name begins with a dot, as those of settings and keys
/// do, has control characters, or another ending than that of the file's format.
/// @param ending with its dot
std::filesystem::path MapPathBelow(const std::filesystem::path& folder, const std::filesystem::path& path,
                                   const std::string& ending);

/// For messages about a file that was there before.
constexpr char kReplaced[] = ", in place of the file of that name";

enum class MapFormat { kPly, kPcd };

/// Writes x y z, normal, colour and confidence of each point. The file appears under its name only when it is whole and
/// on the disk. Unless the origin of the coordinates is zero, it is added and positions are in double. Throws
/// InvalidInputError for an empty map or a path that cannot be one, ProcessingError with the system's reason when
/// writing fails.
void WriteMap(const std::filesystem::path& path, const MapCloud& map, MapFormat format, bool binary);
/// The same of a mesh: throws for one without triangles.
void WriteMap(const std::filesystem::path& path, const MapMesh& map, MeshFormat format);
/// The path check of these. Throws InvalidInputError for one that cannot be a file.
void CheckMapPath(const std::filesystem::path& path);

/// Points as PCD files and ROS messages have them: x y z rgb normal_x normal_y normal_z confidence, each a
/// little-endian float32; the bits of rgb are 0x00rrggbb, as PCL reads it.
constexpr const char* kPackedFields[] = {"x", "y", "z", "rgb", "normal_x", "normal_y", "normal_z", "confidence"};
constexpr size_t kPackedPointBytes = 32;

/// @param target kPackedPointBytes per point
void PackPoints(const SurfacePoint* points, size_t count, uint8_t* target);

/// Back again, without a change.
/// @param source kPackedPointBytes per point
PointCloud UnpackPoints(const uint8_t* source, size_t count);

}  // namespace acmp
