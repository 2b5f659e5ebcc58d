#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// Depth (one channel) or normals in the camera frame (three) in COLMAP's format for dense maps: the text
/// "width&height&channels&", then float32, little endian: the rows of the first channel from the top, those of the
/// next. 0 = unknown. Writers go through a temporary file and a rename and throw ProcessingError with the system's
/// reason.
void WriteColmapMap(const std::filesystem::path& path, const Image<float>& map);
void WriteColmapMap(const std::filesystem::path& path, const NormalMap& map);

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

/// Throws InvalidInputError unless COLMAP's text files can hold the image name and the file stays below images/: no
/// spaces or commas, relative, without "." and "..".
void CheckColmapName(const std::string& name);

/// Writes cameras.txt, images.txt and points3D.txt; equal cameras become one. A feature is where a point projects to;
/// points that an image's lens cannot see are not seen by it, and points that no image sees are left out.
void WriteColmapModel(const std::filesystem::path& folder, const std::vector<ColmapModelImage>& images,
                      const std::vector<ColmapModelPoint>& points);

/// Writes fusion.cfg (the images whose maps are there) and patch-match.cfg (the source views of each, best first).
/// @param sources of each image; where there are none COLMAP is told to choose
void WriteColmapLists(const std::filesystem::path& stereo_folder, const std::vector<std::string>& names,
                      const std::vector<std::vector<std::string>>& sources);

}  // namespace acmp
