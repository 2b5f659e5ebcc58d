#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
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

/// Before a file of that path is written: throws InvalidInputError where there is one that a map server has not
/// written, by the list kSavedFiles in its folder, to which the name is added. Throws as FolderRecord::Claim.
void ClaimMapFile(const std::filesystem::path& path);
constexpr char kSavedFiles[] = "saved.txt";

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

/// What WriteColmapFolder has written, and what not.
struct ColmapFolder {
  size_t images = 0;          ///< keyframes that are in the model
  size_t points = 0;          ///< of the cloud; those that no image sees are left out
  size_t without_image = 0;   ///< keyframes that are not in it: no image was kept
  size_t without_points = 0;  ///< the same: the map has nothing of them, as their poses did not fit
};

/// Writes the keyframes that have an image as a COLMAP model, which splat trainers, nerfstudio, OpenMVS and COLMAP
/// read: images/SECONDS_NANOSECONDS_MAPPER.jpg, sparse/0/*.bin (WriteColmapModel) with the poses in use and at most
/// ColmapPoints::kMaxPoints points of the map. Coordinates are the map's local ones. The folder appears under its name
/// only when it is whole and on the disk, in place of an earlier one. Throws InvalidInputError for an empty map, one
/// without images, and a path as CheckFolderIsOurs does, ProcessingError with the system's reason when writing fails.
/// @param check called before each keyframe; what it throws ends the work
ColmapFolder WriteColmapFolder(
    const std::filesystem::path& path, const PlacedKeyframes& map, const std::function<void()>& check = [] {});

/// Points as PCD files and ROS messages have them: x y z rgb normal_x normal_y normal_z confidence, each a
/// little-endian float32, and where points have labels these, as uint32; the bits of rgb are 0x00rrggbb. So PCL reads
/// them.
constexpr const char* kPackedFields[] = {"x", "y", "z", "rgb", "normal_x", "normal_y", "normal_z", "confidence"};
constexpr char kPackedLabel[] = "label";
constexpr size_t PackedPointBytes(bool labels) { return labels ? 36 : 32; }

/// @param target PackedPointBytes per point
void PackPoints(const SurfacePoint* points, size_t count, bool labels, uint8_t* target);

/// Back again, without a change. Throws InvalidInputError for a label above kMaxLabel.
/// @param source PackedPointBytes per point
PointCloud UnpackPoints(const uint8_t* source, size_t count, bool labels);

}  // namespace acmp
