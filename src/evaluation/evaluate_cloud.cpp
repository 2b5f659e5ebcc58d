#include "acmp_mapping/evaluation/evaluate.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/geometry/voxel.h"
#include "evaluate_inputs.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

// Adds the true maps of a scene, of which one at a time is in memory. Returns how many there are.
size_t AddTrueMaps(const CloudEvaluationOptions& options, const Eigen::Vector3d& origin, ObservedSurface* surface) {
  const fs::path folder = FindFolder(options.ground_truth, options.truth.folder);
  size_t maps = 0;
  for (ListedCamera& image : ReadCameraList(options.ground_truth / "cameras.txt")) {
    const DepthMap truth = ReadGroundTruth(folder, image.image.index, options.truth);
    if (truth.empty()) continue;
    image.world_from_cam.translation() -= origin;
    surface->Add(truth, image.camera.Resized(truth.width(), truth.height()), image.world_from_cam.inverse());
    ++maps;
  }
  if (surface->cloud().empty()) {
    throw InvalidInputError(Concat(folder.string(), ": ", maps, " maps, 0 pixels of known depth: must be at least 1"));
  }
  return maps;
}

}  // namespace

CloudEvaluation EvaluateCloudFile(const CloudEvaluationOptions& options) {
  Validate(options.truth);
  CheckPositive("--voxel", options.voxel_size);
  if (options.thresholds.empty()) throw InvalidInputError("--thresholds: 0 values: must be at least 1");
  for (const double threshold : options.thresholds) CheckPositive("--thresholds", threshold);

  CloudEvaluation evaluation;
  evaluation.voxel_size = options.voxel_size;
  ReadOrigin origin;
  const PointCloud reconstruction = options.read_cloud(options.reconstruction, &origin);
  evaluation.reconstructed_points = evaluation.observed_points = reconstruction.size();
  if (!fs::is_directory(options.ground_truth)) {
    const PointCloud truth = options.read_cloud(options.ground_truth, &origin);
    evaluation.true_points = truth.size();
    evaluation.metrics = EvaluateCloud(reconstruction, truth, options.thresholds, options.voxel_size);
    return evaluation;
  }
  const double largest = *std::max_element(options.thresholds.begin(), options.thresholds.end());
  ObservedSurface surface(reconstruction, options.voxel_size / 2, largest);
  evaluation.true_maps = AddTrueMaps(options, origin.value_or(Eigen::Vector3d::Zero()), &surface);
  evaluation.true_points = surface.cloud().size();
  const std::vector<uint8_t>& observed = surface.observed();
  evaluation.observed_points = static_cast<size_t>(std::count(observed.begin(), observed.end(), 1));
  evaluation.metrics = EvaluateCloud(reconstruction, surface.cloud(), options.thresholds, options.voxel_size, observed);
  return evaluation;
}

}  // namespace acmp
