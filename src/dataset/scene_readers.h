#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/scene.h"

namespace acmp {

/// A camera of a COLMAP model in our conventions.
struct ColmapCamera {
  PinholeCamera camera;  ///< pixel centres at integers
  LensDistortion distortion;
};

struct ColmapModel {
  std::vector<SceneImage> images;  ///< in the order of their ids, without paths
  std::vector<Eigen::Vector3d> landmarks_in_world;
  std::vector<std::string> warnings;
};

/// One of COLMAP's camera models: focal lengths, cx, cy, distortion coefficients.
struct ColmapCameraModel {
  const char* name;
  int id;
  int focal_lengths;  ///< 1: fx = fy
  int parameters;     ///< in all
  LensDistortion::Model model;
};

/// Looks a model up; InvalidInputError naming `where` and the model for one that cannot be undistorted here.
const ColmapCameraModel& FindColmapCameraModel(const std::string& where, const std::string& name);
const ColmapCameraModel& FindColmapCameraModel(const std::string& where, int id);

/// Converts COLMAP's parameters (pixel centres at +0.5), which are finite.
ColmapCamera MakeColmapCamera(const std::string& where, const ColmapCameraModel& model, int64_t width, int64_t height,
                              const std::vector<double>& parameters);

/// Pose from COLMAP's quaternion (w x y z) and translation, which are finite. A quaternion off unit length by more than
/// 1e-3 is refused.
RigidTransform MakeColmapPose(const std::string& where, const Eigen::Vector4d& quaternion_wxyz,
                              const Eigen::Vector3d& translation);

/// The folder among `root`, `root/sparse`, `root/sparse/0` that holds a model, if any.
std::optional<std::filesystem::path> FindColmapModel(const std::filesystem::path& root);

/// Reads a model, binary where both kinds are there (as COLMAP does). Where no point has a track, as other programs
/// write models, each image gets those that it could see. Warns where features do not lie where their points project
/// to, and where a text file has fewer records than it announces.
ColmapModel ReadColmapModel(const std::filesystem::path& folder);

Scene ReadColmapScene(const std::filesystem::path& root, const std::filesystem::path& model_folder,
                      const std::filesystem::path& image_folder);

/// True when `root` has the parts that make it an MVSNet scene: cams/ and pair.txt.
bool LooksLikeMvsnet(const std::filesystem::path& root);
Scene ReadMvsnetScene(const std::filesystem::path& root, const std::filesystem::path& image_folder,
                      PixelCenters centers);

}  // namespace acmp
