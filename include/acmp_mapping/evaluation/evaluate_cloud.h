#pragma once

#include <filesystem>
#include <vector>

#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/ground_truth.h"

namespace acmp {

struct CloudEvaluationOptions {
  std::filesystem::path reconstruction;  ///< PLY
  std::filesystem::path ground_truth;    ///< PLY, or a scene: folder with cameras.txt and true depth maps
  GroundTruthOptions truth;              ///< of a scene
  std::vector<double> thresholds = {0.02, 0.05};
  double voxel_size = 0.01;
};

struct CloudEvaluation {
  size_t reconstructed_points = 0;
  size_t observed_points = 0;  ///< of the reconstructed ones, those that count for accuracy; all against a PLY
  size_t true_points = 0;
  size_t true_maps = 0;  ///< 0 against a PLY
  double voxel_size = 0;
  std::vector<CloudMetrics> metrics;
};

/// Compares a cloud with the truth. A scene's true maps become an ObservedSurface with points half a voxel apart and
/// the largest threshold as tolerance: points of the reconstruction that no map observes do not count for accuracy. A
/// map of another size than its camera in cameras.txt is taken as the whole image at that size. Throws
/// InvalidInputError for whatever is missing, unreadable or out of bounds.
CloudEvaluation EvaluateCloudFile(const CloudEvaluationOptions& options);

}  // namespace acmp
