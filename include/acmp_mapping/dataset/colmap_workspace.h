#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/geometry/posed_camera.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// Depth (one channel) or normals in the camera frame (three) in COLMAP's format for dense maps: the text
/// "width&height&channels&", then float32, little endian: the rows of the first channel from the top, those of the
/// next. 0 = unknown. Writers go through a temporary file and a rename and throw ProcessingError with the system's
/// reason.
void WriteColmapMap(const std::filesystem::path& path, const Image<float>& map);
void WriteColmapMap(const std::filesystem::path& path, const NormalMap& map);
/// Back again. Throws InvalidInputError for what is no such file of one channel.
Image<float> ReadColmapMap(const std::filesystem::path& path);

/// An image of a COLMAP model.
struct ColmapModelImage {
  int id = 0;            ///< COLMAP's IMAGE_ID: positive, unique
  std::string name;      ///< below images/, may have folders
  PinholeCamera camera;  ///< pixel centres at integers: COLMAP's +0.5 is added when it is written
  RigidTransform cam_from_world = RigidTransform::Identity();
  LensDistortion distortion = {};  ///< none (PINHOLE) or kEquidistant (OPENCV_FISHEYE)
};

/// A point of a COLMAP model.
struct ColmapModelPoint {
  Eigen::Vector3d position_in_world = Eigen::Vector3d::Zero();
  Rgb color;
  std::vector<size_t> images;  ///< those that see it: places in the list of images, each once
};

/// Points of a model from a dense cloud: which images see each is told by the images' depth maps. One that no depth map
/// confirms is given to the first image that has no depth there. Of the images that see a point kMaxTrack are taken,
/// chosen at random but always the same: enough for programs to tell which images overlap.
class ColmapPoints {
 public:
  static constexpr size_t kMaxPoints = 500000;  ///< of a larger cloud every n-th: what splats start from is rarely more
  static constexpr size_t kMaxTrack = 8;
  static constexpr double kMaxRelativeDepth = 0.02;  ///< between a point that is seen and the depth map, as in fusion

  /// @param cloud about evenly dense
  /// @param origin of its coordinates, which is added
  explicit ColmapPoints(const PointCloud& cloud, const Eigen::Vector3d& origin = Eigen::Vector3d::Zero());

  /// @param image its place in the model's list of images
  /// @param depth z of the camera's pixels, unit of the points; 0: unknown
  void AddImage(size_t image, const PosedCamera& camera, const DepthMap& depth);

  /// Once, when all images are added.
  std::vector<ColmapModelPoint> Take();

 private:
  static constexpr uint32_t kNone = ~uint32_t{0};
  std::vector<ColmapModelPoint> points_;
  std::vector<uint32_t> views_;        ///< of each point: images that see it
  std::vector<uint32_t> unconfirmed_;  ///< of each point: the first image that may see it, or kNone
};

/// Throws InvalidInputError unless COLMAP's text files can hold the image name and the file stays below images/: no
/// spaces or commas, relative, without "." and "..".
void CheckColmapName(const std::string& name);

/// What WriteColmapModel writes, by name in the workspace.
std::set<std::string> ColmapModelFiles();

/// Writes sparse/0/{cameras,images,points3D}.bin of a workspace, with links to them in sparse/: what reads models finds
/// them in one or the other. Equal cameras become one. A feature is where a point projects to; points that an
/// image's lens cannot see are not seen by it, and points that no image sees are left out.
void WriteColmapModel(const std::filesystem::path& workspace, const std::vector<ColmapModelImage>& images,
                      const std::vector<ColmapModelPoint>& points);

/// Writes fusion.cfg (the images whose maps are there) and patch-match.cfg (the source views of each, best first).
/// @param sources of each image; where there are none COLMAP is told to choose
void WriteColmapLists(const std::filesystem::path& stereo_folder, const std::vector<std::string>& names,
                      const std::vector<std::vector<std::string>>& sources);

}  // namespace acmp
