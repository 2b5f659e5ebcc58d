#include "acmp_mapping/evaluation/evaluate.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/geometry/voxel.h"
#include "evaluate_inputs.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

constexpr const char* kIndexName = "index.json";

nlohmann::json ReadIndex(const fs::path& path) {
  std::ifstream stream(path);
  if (!stream) throw InvalidInputError(Concat(path.string(), ": cannot be read"));
  nlohmann::json index = nlohmann::json::parse(stream, nullptr, false);
  if (!index.is_object() || !index.contains("tiles") || !index["tiles"].is_array()) {
    throw InvalidInputError(Concat(path.string(), ": must be JSON with a list \"tiles\""));
  }
  return index;
}

void AppendTile(const fs::path& index, const nlohmann::json& tile, PointCloud* points, ReadOrigin* origin) {
  const auto has = [&tile](const char* key) { return tile.is_object() && tile.contains(key); };
  if (!has("file") || !tile["file"].is_string() || !has("points") || !tile["points"].is_number_unsigned()) {
    throw InvalidInputError(Concat(index.string(),
                                   ": a tile must have \"file\", a name, and \"points\", a number, and is ",
                                   tile.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).substr(0, 100)));
  }
  const fs::path name = tile["file"].get<std::string>();
  if (name != name.filename()) {
    throw InvalidInputError(Concat(index.string(), ": file ", name, ": must be in the same folder"));
  }
  const fs::path path = index.parent_path() / name;
  const PointCloud read = ReadPly(path, origin);
  const auto listed = tile["points"].get<uint64_t>();
  if (read.size() != listed) {
    throw InvalidInputError(
        Concat(path.string(), ": has ", read.size(), " points: must be ", listed, ", as ", kIndexName, " says"));
  }
  points->insert(points->end(), read.begin(), read.end());
}

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

PointCloud ReadCloud(const fs::path& path, double mesh_spacing, ReadOrigin* origin) {
  const fs::path index_path = path.filename() == kIndexName ? path : path / kIndexName;
  if (index_path != path && !fs::exists(index_path)) {
    TriangleMesh mesh = ReadPlyMesh(path, origin);
    return mesh.triangles.empty() ? std::move(mesh.vertices) : SampleMesh(mesh, mesh_spacing);
  }
  const nlohmann::json index = ReadIndex(index_path);
  PointCloud points;
  for (const nlohmann::json& tile : index["tiles"]) AppendTile(index_path, tile, &points, origin);
  return points;
}

CloudEvaluation EvaluateCloudFile(const CloudEvaluationOptions& options) {
  Validate(options.truth);
  CheckPositive("--voxel", options.voxel_size);
  if (options.thresholds.empty()) throw InvalidInputError("--thresholds: 0 values: must be at least 1");
  for (const double threshold : options.thresholds) CheckPositive("--thresholds", threshold);

  CloudEvaluation evaluation;
  evaluation.voxel_size = options.voxel_size;
  ReadOrigin origin;
  const PointCloud reconstruction = ReadCloud(options.reconstruction, options.voxel_size / 2, &origin);
  evaluation.reconstructed_points = evaluation.observed_points = reconstruction.size();
  if (!fs::is_directory(options.ground_truth)) {
    const PointCloud truth = ReadCloud(options.ground_truth, options.voxel_size / 2, &origin);
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
