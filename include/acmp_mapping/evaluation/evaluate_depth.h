#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/evaluation/depth_metrics.h"
#include "acmp_mapping/evaluation/ground_truth.h"

namespace acmp {

struct DepthEvaluationOptions {
  std::filesystem::path scene;
  std::filesystem::path predictions;
  GroundTruthOptions truth;
  std::string name;                ///< see FindPredictions
  double scale = 1.0;              ///< predictions are multiplied by it, > 0
  bool median_scale = false;       ///< then each by its own MedianScale
  double low_texture = 4.0;        ///< grey levels; 0 turns the row off
  std::set<int> subset;            ///< image indices; empty: all
  std::vector<std::string> masks;  ///< folders of 8-bit pictures, each a row of its own
};

struct ImageEvaluation {
  int index = 0;
  std::string name;
  bool has_prediction = false;
  DepthMetrics metrics;
};

/// Mean over the images in which a region has more than 50 ground-truth pixels.
struct RegionEvaluation {
  std::string name;
  double share = 0;  ///< mean share of ground-truth pixels in the region, 0..1
  DepthMetrics mean;
};

struct DepthEvaluation {
  std::vector<ImageEvaluation> images;  ///< those with ground truth
  DepthMetrics mean;
  DepthMetrics pool;                      ///< all pixels of all images together
  std::vector<RegionEvaluation> regions;  ///< "lowtex", then the masks, as far as they occur
  std::vector<std::string> notes;
};

/// Compares the depth maps of a folder with a scene's ground truth. Throws InvalidInputError for whatever is missing,
/// unreadable or out of bounds.
DepthEvaluation EvaluateDepthFolder(const DepthEvaluationOptions& options);

/// 8-bit grey values of a picture file as OpenCV's imread(IMREAD_GRAYSCALE) gives them: the luma of a JPEG, for others
/// libpng's weighted sum, rounded down.
Image<unsigned char> ReadGray8(const std::filesystem::path& path);

/// 1 where the 11x11 neighbourhood in the picture, resized to width x height, has a standard deviation below
/// `threshold`.
Image<unsigned char> LowTextureMask(Image<unsigned char> picture, int width, int height, double threshold);

}  // namespace acmp
