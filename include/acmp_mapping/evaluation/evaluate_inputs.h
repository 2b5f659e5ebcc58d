#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// A line of a scene's cameras.txt.
struct EvaluationImage {
  int index = 0;
  std::string name;  ///< file name within images/
};

/// Reads index and name of each line of SCENE/cameras.txt. Throws InvalidInputError naming file and line.
std::vector<EvaluationImage> ReadImageList(const std::filesystem::path& scene);

struct EvaluationCamera {
  EvaluationImage image;
  PinholeCamera camera;
  RigidTransform world_from_cam;
};

/// Reads whole lines of SCENE/cameras.txt: index filename fx fy cx cy width height qw qx qy qz tx ty tz, where the last
/// seven are T_world_cam (camera to world; the quaternion of any length > 0). Throws InvalidInputError naming file and
/// line.
std::vector<EvaluationCamera> ReadCameraList(const std::filesystem::path& scene);

/// "0,3,7-12" as a set. Throws InvalidInputError.
std::set<int> ParseSubset(const std::string& text);

struct PredictionIndex {
  std::map<int, std::filesystem::path> files;  ///< by image index
  std::vector<std::string> notes;              ///< what was left aside, for the user
};

/// Finds the depth maps of a folder: .pfm, .dmb or .png named by the image's own stem or by its index (the last number
/// in the file name), or ACMP's own output (2333_<index>/depths_geom.dmb, else depths_prior.dmb, else depths.dmb).
/// Where an image has a .pfm and another file the .pfm counts. `name`, if not empty, is the file to read in 2333_*
/// folders, else a regular expression that file names must contain. Throws InvalidInputError when the folder or every
/// map is missing.
PredictionIndex FindPredictions(const std::filesystem::path& folder, const std::vector<EvaluationImage>& images,
                                const std::string& name);

/// Reads .pfm, .dmb or 16-bit .png with `png_unit` counts per scene unit. What is not finite and > 0 becomes 0.
DepthMap ReadDepthMap(const std::filesystem::path& path, double png_unit);

/// Where the true depth maps of a scene are and how they are stored: 000007.png, .pfm or .dmb for image 7.
struct GroundTruthOptions {
  std::string folder = "depth";  ///< in the scene, or anywhere
  double png_unit = 1000.0;      ///< counts of .png files per scene unit, > 0
  double max_depth = 0;          ///< what is beyond is left out; 0: none
};

/// Throws InvalidInputError for values out of bounds.
void Validate(const GroundTruthOptions& options);

/// The true map of an image; empty when the folder has none.
DepthMap ReadGroundTruth(const std::filesystem::path& folder, int index, const GroundTruthOptions& options);

/// Throws InvalidInputError unless the value is positive and finite.
void CheckPositive(const char* name, double value);

/// ".jpg" for "a/B.JPG".
std::string LowerExtension(const std::filesystem::path& path);

/// The folder of ground truth or masks: `name` within the scene if there is one, else `name` itself. Throws
/// InvalidInputError when neither exists.
std::filesystem::path FindFolder(const std::filesystem::path& scene, const std::string& name);

/// FOLDER/000007.EXT with the first of `extensions` that exists; empty when none does.
std::filesystem::path FindMap(const std::filesystem::path& folder, int index,
                              const std::vector<std::string>& extensions);

}  // namespace acmp
