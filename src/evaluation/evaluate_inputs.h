#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/evaluate.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

struct PredictionIndex {
  std::map<int, std::filesystem::path> files;  ///< by image index
  std::vector<std::string> notes;              ///< what was left aside, for the user
};

/// Finds the depth maps of a folder: .pfm, .dmb or .png named by the image's own stem or by its index (the last number
/// in the file name), or ACMP's own output (2333_<index>/depths_geom.dmb, else depths_prior.dmb, else depths.dmb).
/// Of several for one image .pfm goes before .dmb and that before .png. `name`, if not empty, is the file to read in
/// 2333_* folders, else a regular expression that file names must contain. Throws InvalidInputError when the folder or
/// every map is missing.
PredictionIndex FindPredictions(const std::filesystem::path& folder, const std::vector<ListedImage>& images,
                                const std::string& name);

/// The true map of an image; empty when the folder has none.
DepthMap ReadGroundTruth(const std::filesystem::path& folder, int index, const GroundTruthOptions& options);

/// The folder of ground truth or masks: `name` within the scene if there is one, else `name` itself. Throws
/// InvalidInputError when neither exists.
std::filesystem::path FindFolder(const std::filesystem::path& scene, const std::string& name);

/// FOLDER/000007.EXT with the first of `extensions` that exists; empty when none does.
std::filesystem::path FindMap(const std::filesystem::path& folder, int index,
                              const std::vector<std::string>& extensions);

}  // namespace acmp
