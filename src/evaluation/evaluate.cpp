#include "acmp_mapping/evaluation/evaluate.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/image/image_processing.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

void Check(const GroundTruthOptions& options) {
  CheckPositive("--gt-png-unit", options.png_unit);
  CheckRange("--max-depth", options.max_depth, 0.0, 1e9);
}

// The folder of ground truth or masks: `name` within the scene if there is one, else `name` itself.
// `option` names another one.
fs::path FindFolder(const fs::path& scene, const std::string& name, const char* option) {
  for (const fs::path& folder : {scene / name, fs::path(name)}) {
    if (fs::is_directory(folder)) return folder;
  }
  throw InvalidInputError(Concat("no folder ", (scene / name).string(), " nor ", name, ": name it with ", option));
}

// The first of these of an image, by its name or by its index: FOLDER/IMAGE.EXT, 000007.EXT or 00000007.EXT, in the
// order of the extensions. Empty when there is none.
fs::path FindMap(const fs::path& folder, const ListedImage& image, const std::vector<std::string>& extensions) {
  const std::string names[] = {fs::path(image.name).replace_extension().string(), StringPrintf("%06d", image.index),
                               StringPrintf("%08d", image.index)};
  for (const std::string& extension : extensions) {
    for (const std::string& name : names) {
      fs::path path = folder / (name + extension);
      if (fs::exists(path)) return path;
    }
  }
  return {};
}

// The true map of an image; empty when the folder has none.
DepthMap ReadGroundTruth(const fs::path& folder, const ListedImage& image, const GroundTruthOptions& options) {
  const fs::path path = FindMap(folder, image, {".png", ".pfm", ".dmb"});
  if (path.empty()) return {};
  DepthMap truth = ReadDepth(path, options.png_unit);
  if (options.max_depth > 0) {
    const auto limit = static_cast<float>(options.max_depth);
    std::replace_if(
        truth.begin(), truth.end(), [limit](float z) { return z > limit; }, 0.0f);
  }
  return truth;
}

// Gathers one region's metrics over the images.
class RegionMean {
 public:
  explicit RegionMean(std::string name) : name_(std::move(name)) {}

  void Add(const DepthMap& estimate, const DepthMap& truth, const Image<unsigned char>& mask, size_t truth_pixels) {
    constexpr size_t kMinPixels = 50;  // fewer say nothing
    const DepthMetrics metrics = EvaluateDepth(estimate, truth, mask.View());
    if (metrics.ground_truth_pixels <= kMinPixels) return;
    metrics_.push_back(metrics);
    share_sum_ += static_cast<double>(metrics.ground_truth_pixels) / truth_pixels;
  }

  void AppendTo(std::vector<RegionEvaluation>* regions) const {
    if (!metrics_.empty()) regions->push_back({name_, share_sum_ / metrics_.size(), Mean(metrics_)});
  }

 private:
  std::string name_;
  std::vector<DepthMetrics> metrics_;
  double share_sum_ = 0;
};

void Multiply(double factor, DepthMap* depths) {
  for (float& depth : *depths) depth *= static_cast<float>(factor);
}

DepthMap ReadPrediction(const fs::path& path, double scale) {
  DepthMap estimate = ReadDepth(path);
  Multiply(scale, &estimate);
  return estimate;
}

// Empty when the folder has none for this image.
Image<unsigned char> ReadMask(const fs::path& folder, const ListedImage& image, const DepthMap& truth) {
  const fs::path path = FindMap(folder, image, {".png"});
  if (path.empty()) return {};
  const ColorImage picture = ReadColorImage(path);
  if (picture.width() != truth.width() || picture.height() != truth.height()) {
    throw InvalidInputError(Concat(path.string(), ": size ", picture.width(), " x ", picture.height(),
                                   ": must be the ground truth's, ", truth.width(), " x ", truth.height()));
  }
  Image<unsigned char> mask(picture.width(), picture.height());
  std::transform(picture.begin(), picture.end(), mask.begin(), [](const Rgb& c) { return c.r; });
  return mask;
}

void Check(const DepthEvaluationOptions& options) {
  CheckPositive("--scale", options.scale);
  Check(options.truth);
  CheckRange("--lowtex", options.low_texture, 0.0, 255.0);
}

// Adds the true maps of a scene, of which one at a time is in memory. Returns how many there are.
size_t AddTrueMaps(const CloudEvaluationOptions& options, const Eigen::Vector3d& origin, ObservedSurface* surface) {
  const fs::path folder = FindFolder(options.ground_truth, options.truth.folder, "--gt");
  size_t maps = 0;
  for (ListedCamera& image : ReadCameraList(options.ground_truth / "cameras.txt")) {
    const DepthMap truth = ReadGroundTruth(folder, image.image, options.truth);
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

Image<unsigned char> LowTextureMask(GrayImage picture, int width, int height, double threshold) {
  constexpr int kWindow = 11;
  if (picture.width() != width || picture.height() != height) picture = Resize(picture, width, height);
  const cv::Mat gray = AsMat(picture);
  cv::Mat mean, mean_square;
  cv::blur(gray, mean, {kWindow, kWindow});
  cv::blur(gray.mul(gray), mean_square, {kWindow, kWindow});
  Image<unsigned char> mask(width, height);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      const float mu = mean.at<float>(row, col);
      const float variance = std::max(mean_square.at<float>(row, col) - mu * mu, 0.0f);
      mask(col, row) = std::sqrt(variance) < static_cast<float>(threshold) ? 1 : 0;
    }
  }
  return mask;
}

DepthEvaluation EvaluateDepthFolder(const DepthEvaluationOptions& options) {
  Check(options);
  std::vector<ListedImage> images;
  for (const ListedCamera& camera : ReadCameraList(options.scene / "cameras.txt")) images.push_back(camera.image);
  const fs::path truth_folder = FindFolder(options.scene, options.truth.folder, "--gt");
  if (!fs::is_directory(options.predictions)) {
    throw InvalidInputError(Concat(options.predictions.string(), ": no such folder of predictions"));
  }

  DepthEvaluation evaluation;
  DepthErrors pool;
  RegionMean low_texture("lowtex");
  std::vector<std::pair<fs::path, RegionMean>> masks;
  for (const std::string& mask : options.masks) {
    masks.emplace_back(FindFolder(options.scene, mask, "--mask"), RegionMean(fs::path(mask).filename().string()));
  }
  size_t without_picture = 0;
  bool any = false;
  for (const ListedImage& image : images) {
    if (!options.subset.empty() && options.subset.count(image.index) == 0) continue;
    const DepthMap truth = ReadGroundTruth(truth_folder, image, options.truth);
    if (truth.empty()) continue;
    const fs::path found = FindMap(options.predictions, image, {".pfm", ".dmb", ".png"});
    DepthMap estimate = found.empty() ? DepthMap() : ReadPrediction(found, options.scale);
    if (options.median_scale) Multiply(MedianScale(estimate, truth), &estimate);
    const DepthMetrics metrics = EvaluateDepth(estimate, truth);
    evaluation.images.push_back({image.index, image.name, !found.empty(), metrics});
    any |= !found.empty();
    pool.Add(estimate, truth);

    const fs::path picture = options.scene / "images" / image.name;
    if (options.low_texture > 0 && fs::exists(picture)) {
      const auto mask =
          LowTextureMask(ToGray(ReadColorImage(picture)), truth.width(), truth.height(), options.low_texture);
      low_texture.Add(estimate, truth, mask, metrics.ground_truth_pixels);
    } else if (options.low_texture > 0) {
      ++without_picture;
    }
    for (auto& [folder, region] : masks) {
      const Image<unsigned char> mask = ReadMask(folder, image, truth);
      if (!mask.empty()) region.Add(estimate, truth, mask, metrics.ground_truth_pixels);
    }
  }
  if (evaluation.images.empty()) throw InvalidInputError(Concat("no ground truth found in ", truth_folder.string()));
  if (!any) {
    throw InvalidInputError(Concat(options.predictions.string(),
                                   ": no .pfm, .dmb or .png named after an image with ground truth, or its index, as ",
                                   "000007.pfm"));
  }

  std::vector<DepthMetrics> metrics;
  for (const ImageEvaluation& image : evaluation.images) metrics.push_back(image.metrics);
  evaluation.mean = Mean(metrics);
  evaluation.pool = pool.Metrics();
  low_texture.AppendTo(&evaluation.regions);
  for (const auto& [folder, region] : masks) region.AppendTo(&evaluation.regions);
  if (without_picture > 0)
    evaluation.notes.push_back(Concat(without_picture, " images left out of lowtex: no picture"));
  return evaluation;
}

PointCloud ReadCloud(const fs::path& path, double mesh_spacing, ReadOrigin* origin) {
  TriangleMesh mesh = ReadPly(path, origin);
  return mesh.triangles.empty() ? std::move(mesh.vertices) : SampleMesh(mesh, mesh_spacing);
}

CloudEvaluation EvaluateCloudFile(const CloudEvaluationOptions& options) {
  Check(options.truth);
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
