#include "acmp_mapping/evaluation/evaluate.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/geometry/voxel.h"
#include "evaluate_inputs.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

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
Image<unsigned char> ReadMask(const fs::path& folder, int index, const DepthMap& truth) {
  const fs::path path = FindMap(folder, index, {".png"});
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
  Validate(options.truth);
  CheckRange("--lowtex", options.low_texture, 0.0, 255.0);
}

}  // namespace

Image<unsigned char> ReadGray8(const fs::path& path) {
  // 15-bit weights of red, green and blue.
  constexpr unsigned kRed = 9797, kGreen = 19234, kBlue = 3737, kHalf = 1u << 14;
  const std::string extension = LowerExtension(path);
  const unsigned rounding = extension == ".jpg" || extension == ".jpeg" ? kHalf : 0;
  const ColorImage color = ReadColorImage(path);
  Image<unsigned char> gray(color.width(), color.height());
  std::transform(color.begin(), color.end(), gray.begin(), [rounding](const Rgb& c) {
    return static_cast<unsigned char>((kRed * c.r + kGreen * c.g + kBlue * c.b + rounding) >> 15);
  });
  return gray;
}

Image<unsigned char> LowTextureMask(Image<unsigned char> picture, int width, int height, double threshold) {
  constexpr int kWindow = 11;
  cv::Mat gray(picture.height(), picture.width(), CV_8U, picture.data());
  if (gray.cols != width || gray.rows != height) {
    cv::Mat resized;
    cv::resize(gray, resized, {width, height}, 0, 0, cv::INTER_AREA);
    gray = resized;
  }
  cv::Mat mean, mean_square;
  gray.convertTo(gray, CV_32F);
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
  const fs::path truth_folder = FindFolder(options.scene, options.truth.folder);
  PredictionIndex predictions = FindPredictions(options.predictions, images, options.name);

  DepthEvaluation evaluation;
  evaluation.notes = std::move(predictions.notes);
  DepthErrors pool;
  RegionMean low_texture("lowtex");
  std::vector<std::pair<fs::path, RegionMean>> masks;
  for (const std::string& mask : options.masks) {
    masks.emplace_back(FindFolder(options.scene, mask), RegionMean(fs::path(mask).filename().string()));
  }
  size_t without_picture = 0;
  for (const ListedImage& image : images) {
    if (!options.subset.empty() && options.subset.count(image.index) == 0) continue;
    const DepthMap truth = ReadGroundTruth(truth_folder, image.index, options.truth);
    if (truth.empty()) continue;
    const auto found = predictions.files.find(image.index);
    const bool has_prediction = found != predictions.files.end();
    DepthMap estimate = has_prediction ? ReadPrediction(found->second, options.scale) : DepthMap();
    if (options.median_scale) Multiply(MedianScale(estimate, truth), &estimate);
    const DepthMetrics metrics = EvaluateDepth(estimate, truth);
    evaluation.images.push_back({image.index, image.name, has_prediction, metrics});
    pool.Add(estimate, truth);

    const fs::path picture = options.scene / "images" / image.name;
    if (options.low_texture > 0 && fs::exists(picture)) {
      const auto mask = LowTextureMask(ReadGray8(picture), truth.width(), truth.height(), options.low_texture);
      low_texture.Add(estimate, truth, mask, metrics.ground_truth_pixels);
    } else if (options.low_texture > 0) {
      ++without_picture;
    }
    for (auto& [folder, region] : masks) {
      const Image<unsigned char> mask = ReadMask(folder, image.index, truth);
      if (!mask.empty()) region.Add(estimate, truth, mask, metrics.ground_truth_pixels);
    }
  }
  if (evaluation.images.empty()) throw InvalidInputError(Concat("no ground truth found in ", truth_folder.string()));

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

}  // namespace acmp
