#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/ground_truth.h"

namespace acmp {

struct CloudEvaluationOptions {
  std::filesystem::path reconstruction;  ///< what read_cloud reads
  std::filesystem::path ground_truth;    ///< the same, or a scene: folder with cameras.txt and true depth maps
  GroundTruthOptions truth;              ///< of a scene
  std::vector<double> thresholds = {0.02, 0.05};
  double voxel_size = 0.01;
  std::function<PointCloud(const std::filesystem::path&)> read_cloud = ReadPly;  ///< throws InvalidInputError
};

struct CloudEvaluation {
  size_t reconstructed_points = 0;
  size_t observed_points = 0;  ///< of the reconstructed ones, those that count for accuracy; all against a file
  size_t true_points = 0;
  size_t true_maps = 0;  ///< 0 against a file
  double voxel_size = 0;
  std::vector<CloudMetrics> metrics;
};

/// Compares a cloud with the truth. A scene's true maps become an ObservedSurface with points half a voxel apart and
/// the largest threshold as tolerance: points of the reconstruction that no map observes do not count for accuracy. A
/// map of another size than its camera in cameras.txt is taken as the whole image at that size. Throws
/// InvalidInputError for whatever is missing, unreadable or out of bounds.
CloudEvaluation EvaluateCloudFile(const CloudEvaluationOptions& options);

}  // namespace acmp
