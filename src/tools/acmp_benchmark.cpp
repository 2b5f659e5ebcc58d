// Time per stage of Algorithm 1 on synthetic images of given sizes, and its ratio to the texture floor.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "acmp_mapping/backend/make_patch_match.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "tool_main.h"
#ifdef ACMP_HAVE_CUDA
#include "acmp_mapping/backend/texture_rate.h"
#endif

namespace acmp {
namespace {

struct Arguments {
  std::vector<std::string> sizes = {"640x480", "3072x2048"};
  int source_views = 10;
  int repetitions = 5;
  std::string preset = "acmp";
  std::string device = "auto";
  int cuda_index = 0;
  std::string json;
};

/// Samples per pixel and source view of the full schedule: 144 NCCs of 36 samples (1 + 3 * 14 photometric, the same
/// with the prior, 2 * (1 + 2 * 14) geometric).
constexpr double kSamplesPerPixelAndView[] = {43.0 * 36, 43.0 * 36, 58.0 * 36};

struct Row {
  int width = 0, height = 0;
  double photometric_ms = 0, prior_construction_ms = 0, planar_prior_ms = 0,
         geometric_ms = 0;  // device, CPU, device, device
  double whole_ms = 0;      // wall time with transfers
};

/// Fronto-parallel textured plane at depth 10 seen by cameras on a grid around the reference.
std::vector<FramePtr> MakeFrames(int width, int height, int source_views) {
  constexpr double kDepth = 10.0;
  GrayImage texture(width, height);
  cv::Mat texture_mat = AsMat(texture);
  cv::RNG random(7);
  random.fill(texture_mat, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(texture_mat, texture_mat, cv::Size(0, 0), 1.5);
  cv::normalize(texture_mat, texture_mat, 0, 255, cv::NORM_MINMAX);

  std::vector<FramePtr> frames;
  for (int i = 0; i <= source_views; ++i) {
    auto frame = std::make_shared<Frame>();
    frame->id = i;
    frame->camera = {width, height, 0.9 * width, 0.9 * width, 0.5 * (width - 1), 0.5 * (height - 1)};
    // Sources lie at alternating sides, about 5 degrees of triangulation angle apart.
    const double x = i == 0 ? 0.0 : (i % 2 == 0 ? 1 : -1) * (0.5 + 0.08 * i);
    const double y = i == 0 ? 0.0 : (i % 4 < 2 ? 1 : -1) * 0.3;
    frame->cam_from_world.translation() = Eigen::Vector3d(-x, -y, 0);
    frame->gray = GrayImage(width, height);
    cv::Mat gray = AsMat(frame->gray);
    const double f = frame->camera.fx;
    const cv::Matx23d shift(1, 0, -x * f / kDepth, 0, 1, -y * f / kDepth);
    cv::warpAffine(texture_mat, gray, shift, gray.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
    frames.push_back(frame);
  }
  return frames;
}

double Median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<long>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

Row Measure(PatchMatch* patch_match, const PipelineOptions& options, const Arguments& arguments, int width,
            int height) {
  const std::vector<FramePtr> frames = MakeFrames(width, height, arguments.source_views);
  const std::vector<FramePtr> sources(frames.begin() + 1, frames.end());
  const DepthRange range = {4.0f, 40.0f};
  PipelineOptions photometric_only = options;
  photometric_only.use_planar_prior = false;
  DepthEstimator photometric(patch_match, photometric_only), estimator(patch_match, options);

  std::vector<double> samples[5];
  for (int i = 0; i <= arguments.repetitions; ++i) {
    photometric.EstimateInitial(*frames[0], sources, range);
    const double photometric_ms = photometric.last_times().kernels_ms;
    Timer whole;
    PatchMatchResult state = estimator.EstimateInitial(*frames[0], sources, range);
    const StageTimes initial = estimator.last_times();
    const DepthMap depth = ToDepthMap(state.planes, frames[0]->camera);
    const std::vector<const DepthMap*> depths(sources.size(), &depth);
    double geometric_ms = 0;
    for (int pass = 0; pass < options.geometric_passes; ++pass) {
      state = estimator.RefineGeometric(*frames[0], sources, depths, range, state, pass);
      geometric_ms += estimator.last_times().kernels_ms;
    }
    if (i == 0) continue;  // warm-up
    const double values[] = {photometric_ms, initial.prior_construction_ms,
                             options.use_planar_prior ? initial.kernels_ms - photometric_ms : 0, geometric_ms,
                             whole.Lap()};
    for (int k = 0; k < 5; ++k) samples[k].push_back(values[k]);
  }
  return {width,
          height,
          Median(samples[0]),
          Median(samples[1]),
          Median(samples[2]),
          Median(samples[3]),
          Median(samples[4])};
}

void PrintCell(double ms, double samples, double rate) {
  std::cout << std::setw(10) << std::fixed << std::setprecision(2) << ms;
  if (rate > 0 && ms > 0) {
    std::cout << " (" << std::setprecision(2) << ms / (1e3 * samples / rate) << "x)";
  } else {
    std::cout << "        ";
  }
}

void PrintTable(const std::vector<Row>& rows, const Arguments& arguments, double rate) {
  std::cout << "medians of " << arguments.repetitions
            << " runs after one warm-up, ms per image, V = " << arguments.source_views << ", preset "
            << arguments.preset << "\n";
  if (rate > 0) std::cout << "texture rate " << rate * 1e-12 << "e12 fetches/s; (x): ratio to one fetch per sample\n";
  std::cout << "      size  photometric         planar prior        geometric passes    kernels             prior "
               "build   whole\n";
  for (const Row& row : rows) {
    const double pixels = static_cast<double>(row.width) * row.height * arguments.source_views;
    const double* per_pixel = kSamplesPerPixelAndView;
    std::cout << std::setw(10) << Concat(row.width, "x", row.height);
    PrintCell(row.photometric_ms, pixels * per_pixel[0], rate);
    PrintCell(row.planar_prior_ms, pixels * per_pixel[1], rate);
    PrintCell(row.geometric_ms, pixels * per_pixel[2], rate);
    PrintCell(row.photometric_ms + row.planar_prior_ms + row.geometric_ms,
              pixels * (per_pixel[0] + per_pixel[1] + per_pixel[2]), rate);
    std::cout << std::setw(12) << row.prior_construction_ms << std::setw(10) << row.whole_ms << "\n";
  }
}

void WriteJson(const std::string& path, const std::string& device, const std::vector<Row>& rows,
               const Arguments& arguments, double rate) {
  std::ofstream file(path);
  file << "{\"device\": \"" << device << "\", \"preset\": \"" << arguments.preset
       << "\", \"source_views\": " << arguments.source_views << ", \"texture_fetches_per_s\": " << rate
       << ", \"rows\": [";
  for (size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    file << (i == 0 ? "" : ", ") << "{\"width\": " << row.width << ", \"height\": " << row.height
         << ", \"photometric_ms\": " << row.photometric_ms
         << ", \"prior_construction_ms\": " << row.prior_construction_ms
         << ", \"planar_prior_ms\": " << row.planar_prior_ms << ", \"geometric_ms\": " << row.geometric_ms
         << ", \"whole_ms\": " << row.whole_ms << "}";
  }
  file << "]}\n";
  if (!file.flush()) throw ProcessingError(path + ": cannot be written");
}

void ParseSize(const std::string& text, int* width, int* height) {
  char x = 0, rest = 0;
  std::istringstream stream(text);
  if (!(stream >> *width >> x >> *height) || x != 'x' || stream >> rest) {
    throw InvalidInputError(Concat("--sizes: \"", text, "\": must be WIDTHxHEIGHT, such as 640x480"));
  }
  CheckRange("--sizes: width", *width, 16, 16384);
  CheckRange("--sizes: height", *height, 16, 16384);
}

void Run(const Arguments& arguments) {
  const PipelineOptions options = MakePreset(arguments.preset);
  PatchMatchBackend backend = MakePatchMatch(ParseDevice(arguments.device), arguments.cuda_index);
  std::cout << "device " << backend.patch_match->device_name();
  if (!backend.fallback_reason.empty()) std::cout << ", since " << backend.fallback_reason;
  std::cout << std::endl;
  double rate = 0;
#ifdef ACMP_HAVE_CUDA
  if (backend.patch_match->device_name().find("cuda") != std::string::npos) {
    rate = MeasureTextureRate(arguments.cuda_index);
  }
#endif
  std::vector<Row> rows;
  for (const std::string& size : arguments.sizes) {
    int width = 0, height = 0;
    ParseSize(size, &width, &height);
    rows.push_back(Measure(backend.patch_match.get(), options, arguments, width, height));
  }
  PrintTable(rows, arguments, rate);
  if (!arguments.json.empty()) WriteJson(arguments.json, backend.patch_match->device_name(), rows, arguments, rate);
}

}  // namespace
}  // namespace acmp

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  acmp::Arguments arguments;
  CLI::App app(
      "Measures milliseconds per image of each stage on synthetic images, and on a GPU the ratio to the floor: one "
      "texture fetch per sample of the full schedule, at the fetch rate measured on the same GPU.\n"
      "Example: acmp_benchmark --sizes 640x480,3072x2048 --source-views 10",
      "acmp_benchmark");
  app.add_option("--sizes", arguments.sizes, "Image sizes, WIDTHxHEIGHT")->delimiter(',')->capture_default_str();
  app.add_option("--source-views", arguments.source_views, "Source views")
      ->check(CLI::Range(1, 32))
      ->capture_default_str();
  app.add_option("--repetitions", arguments.repetitions, "Runs per size")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--preset", arguments.preset, "acmh, acmp_no_geometric or acmp")->capture_default_str();
  app.add_option("--device", arguments.device, "auto, cuda or cpu")->capture_default_str();
  app.add_option("--cuda-index", arguments.cuda_index, "Which GPU")->capture_default_str();
  app.add_option("--json", arguments.json, "Also write the figures to this file");
  return acmp::RunTool(app, argc, argv, [&] {
    acmp::Run(arguments);
    return acmp::kExitDone;
  });
}
