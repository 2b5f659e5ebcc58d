#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

class Lens;

/// Portable float maps (PFM, little endian, bottom row first): one channel for depth, cost and confidence, three for
/// normals. Readers throw InvalidInputError naming the file for a wrong header or a truncated body; writers go through
/// a temporary file and a rename and throw ProcessingError with the system's reason.
Image<float> ReadPfm(const std::filesystem::path& path);
NormalMap ReadPfmNormals(const std::filesystem::path& path);
void WritePfm(const std::filesystem::path& path, const ImageView<const float>& map);
void WritePfm(const std::filesystem::path& path, const ImageView<const Vec3f>& map);

/// The .dmb format of Gipuma and ACMP: int32 type = 1, height, width, channels, then float32 row by row.
Image<float> ReadDmb(const std::filesystem::path& path);
void WriteDmb(const std::filesystem::path& path, const ImageView<const float>& map);

/// 16-bit PNG of depth in thousandths of the scene's unit (millimetres for metres); 0 = unknown. Depths above 65.535
/// units cannot be stored: returns how many pixels were left unknown for that reason, for the caller to report.
size_t WriteDepthPng(const std::filesystem::path& path, const ImageView<const float>& depth);

/// Reads depth by extension: .pfm, .dmb, 16-bit .png with `png_unit` counts per unit. Not finite or not positive
/// becomes 0.
DepthMap ReadDepth(const std::filesystem::path& path, double png_unit = 1000);

/// An image of a scene's cameras.txt.
struct ListedImage {
  int index = 0;
  std::string name;  ///< file name within images/, without white space
};

/// A whole line of it: index filename fx fy cx cy width height qw qx qy qz tx ty tz. The last seven are T_world_cam
/// (camera to world), the quaternion of any length > 0. Pixel centres are at integers, lenses have no distortion.
struct ListedCamera {
  ListedImage image;
  PinholeCamera camera;
  RigidTransform world_from_cam = RigidTransform::Identity();
};

/// Throws ProcessingError with the system's reason.
void WriteCameraList(const std::filesystem::path& path, const std::vector<ListedCamera>& cameras);

/// Throws InvalidInputError naming file, line and value.
std::vector<ListedCamera> ReadCameraList(const std::filesystem::path& path);

/// Writes a camera with its lens as camera_calibration does (YAML), which the mapper's ~calibration_file reads. Throws
/// ProcessingError with the system's reason.
/// @param comment lines before it, without '#'
void WriteCalibration(const std::filesystem::path& path, const Lens& lens, const std::string& comment);

/// PLY: x y z nx ny nz (float), red green blue (uchar), confidence (float); label (uchar) where points have labels.
/// @param origin of the points' coordinates (LocalOrigin), which is added: unless it is zero, x y z are double
/// @param binary little-endian; else text
void WritePly(const std::filesystem::path& path, const PointCloud& points,
              const Eigen::Vector3d& origin = Eigen::Vector3d::Zero(), bool binary = true);
/// The same, without labels, of points that come in several clouds, so that never all of them have to be held. The
/// header's length does not depend on their number: a comment fills it up.
class PlyFile {
 public:
  /// @param durability of the finished file
  /// @param origin as for WritePly
  explicit PlyFile(const std::filesystem::path& path, Durability durability = Durability::kPowerCut,
                   const Eigen::Vector3d& origin = Eigen::Vector3d::Zero());
  void Append(const PointCloud& points);
  /// Without it there is no file.
  void Commit();
  size_t points() const { return points_; }

 private:
  std::string Header() const;

  AtomicFile file_;
  const Eigen::Vector3d origin_;
  size_t points_ = 0;
};
/// Where the coordinates of clouds begin that are read to be compared: chosen by the first point that is read
/// (LocalOrigin), so that those of UTM or geocentric coordinates keep their millimetres.
using ReadOrigin = std::optional<Eigen::Vector3d>;
/// A position in the world from there. @param origin null: the world's
Vec3f FromOrigin(const Eigen::Vector3d& position, ReadOrigin* origin);
/// Reads x y z and, where present, normals, colours and confidence of a binary little-endian or ASCII PLY, with the
/// faces if they are the element after the vertices; those of more corners are cut into triangles. Other properties and
/// elements are skipped.
/// @param origin null: the world's
TriangleMesh ReadPly(const std::filesystem::path& path, ReadOrigin* origin = nullptr);

enum class MeshFormat { kPly, kObj };
/// By extension, .ply or .obj, of any case; throws InvalidInputError for another one.
MeshFormat MeshFormatOf(const std::filesystem::path& path);
/// Writes PLY, the points of a cloud and faces, or Wavefront OBJ, with the vertices' colours. Throws InvalidInputError
/// for a mesh without triangles.
/// @param origin as for WritePly
void WriteMesh(const std::filesystem::path& path, const TriangleMesh& mesh, MeshFormat format,
               const Eigen::Vector3d& origin = Eigen::Vector3d::Zero());

/// Of the coordinates in a text file: a float32 reads back, with an origin a billionth of it.
inline int TextDigits(const Eigen::Vector3d& origin) { return origin.isZero(0) ? 9 : 15; }
/// Sum of both in double.
inline Eigen::Vector3d InWorld(const Eigen::Vector3d& origin, const Vec3f& local) {
  return origin + Eigen::Vector3d(local.x, local.y, local.z);
}

/// Pictures to look at. Depth and cost by a perceptually uniform colour map between the 2 % and 98 % quantiles (of
/// inverse depth for depth), unknown pixels black; normals as (n + 1) / 2 with the camera-facing direction light.
ColorImage DepthPicture(const ImageView<const float>& depth);
ColorImage NormalPicture(const ImageView<const Vec3f>& normal);
ColorImage CostPicture(const ImageView<const float>& cost);
ColorImage ConfidencePicture(const ImageView<const float>& confidence);

}  // namespace acmp
