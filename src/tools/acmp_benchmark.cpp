// Time per stage of Algorithm 1, or of a stream through the online mapper, on synthetic images: one table.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "tool_main.h"

namespace acmp {
namespace {

using namespace std::string_literals;

/// What was measured: title of the column, value.
using Figures = std::vector<std::pair<std::string, double>>;

constexpr double kWallDepth = 10.0;
constexpr DepthRange kRange = {4.0f, 40.0f};

/// Noise blurred to features of a few pixels.
cv::Mat MakeTexture(ImageSize size) {
  cv::Mat texture(size.height, size.width, CV_32F);
  cv::RNG random(7);
  random.fill(texture, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(texture, texture, cv::Size(0, 0), 1.5);
  cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
  return texture;
}

/// The wall z = kWallDepth seen from (x, y, 0), with landmarks all over it.
FramePtr MakeWallFrame(const cv::Mat& texture, int64_t id, double x, double y) {
  const int width = texture.cols, height = texture.rows;
  const PinholeCamera camera = {width, height, 0.9 * width, 0.9 * width, 0.5 * (width - 1), 0.5 * (height - 1)};
  RigidTransform cam_from_world = RigidTransform::Identity();
  cam_from_world.translation() = Eigen::Vector3d(-x, -y, 0);
  const double pixels = camera.fx / kWallDepth;
  const cv::Matx23d shift(1, 0, -x * pixels, 0, 1, -y * pixels);
  cv::Mat gray, gray_8bit;
  cv::warpAffine(texture, gray, shift, texture.size(), cv::INTER_LINEAR, cv::BORDER_WRAP);
  gray.convertTo(gray_8bit, CV_8U);
  ColorImage color(width, height);
  cv::Mat color_mat = AsMat(color);
  cv::cvtColor(gray_8bit, color_mat, cv::COLOR_GRAY2RGB);
  std::vector<Eigen::Vector3d> landmarks;
  constexpr int kLandmarkCols = 20, kLandmarkRows = 10;
  for (int row = 0; row < kLandmarkRows; ++row) {
    for (int col = 0; col < kLandmarkCols; ++col) {
      const Eigen::Vector2d pixel((col + 0.5) * width / kLandmarkCols, (row + 0.5) * height / kLandmarkRows);
      landmarks.push_back(cam_from_world.inverse() * camera.Unproject(pixel, kWallDepth));
    }
  }
  return std::make_shared<const Frame>(
      MakeFrame(id, 0.0, std::move(color), camera, cam_from_world, std::move(landmarks), {}));
}

/// Sources lie at alternating sides, about 5 degrees of triangulation angle apart.
std::vector<FramePtr> MakeFrames(ImageSize size, int source_views) {
  const cv::Mat texture = MakeTexture(size);
  std::vector<FramePtr> frames = {MakeWallFrame(texture, 0, 0, 0)};
  for (int i = 1; i <= source_views; ++i) {
    frames.push_back(MakeWallFrame(texture, i, (i % 2 == 0 ? 1 : -1) * (0.5 + 0.08 * i), (i % 4 < 2 ? 1 : -1) * 0.3));
  }
  return frames;
}

/// A keyframe before its grey values and sharpness are made, which takes time of the mapper's thread.
struct FrameWithoutGray {
  FramePtr Make() {
    return std::make_shared<const Frame>(
        MakeFrame(id, 0.0, std::move(color), like->camera, cam_from_world, like->landmarks_in_world, {}));
  }

  int64_t id;
  FramePtr like;
  ColorImage color;
  RigidTransform cam_from_world;
};

/// What a camera sees that goes to and fro along the wall.
class WallStream {
 public:
  /// @param keyframes how many there may be
  WallStream(ImageSize size, int keyframes) {
    const cv::Mat texture = MakeTexture(size);
    constexpr int kDistinct = 64;  // made beforehand
    constexpr double kStep = 0.4;  // 2.3 degrees at the wall
    for (int i = 0; i < std::min(kDistinct, keyframes); ++i) {
      frames_.push_back(MakeWallFrame(texture, i, kStep * i, i % 2 == 0 ? 0.0 : 0.2));
    }
  }

  FrameWithoutGray Next() {
    const int64_t count = static_cast<int64_t>(frames_.size()), lap = next_ / count, place = next_ % count;
    const FramePtr& made = frames_[static_cast<size_t>(lap % 2 == 0 ? place : count - 1 - place)];
    FrameWithoutGray frame = {next_++, made, made->color.Clone(), made->cam_from_world};
    // A place that is visited twice in a row would have no baseline.
    frame.cam_from_world.translation().z() = -1e-3 * static_cast<double>(lap % 2);
    return frame;
  }

 private:
  std::vector<FramePtr> frames_;
  int64_t next_ = 0;
};

double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto place = static_cast<long>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + place, values.end());
  return values[static_cast<size_t>(place)];
}

/// Resident memory of this process.
size_t HostBytes() {
  size_t pages = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  return resident * static_cast<size_t>(sysconf(_SC_PAGESIZE));
}

/// Of the stages, as they are done once.
Figures RunStages(DepthEngine* engine, DepthEstimator* estimator, const PipelineOptions& options, EngineProblem problem,
                  const FramePtr& frame) {
  Timer whole, stage;
  problem.reference.image = engine->Load(frame, options.start_level);
  const double load = stage.Lap();
  const EngineEstimatePtr estimate = estimator->Run(estimator->schedule().front(), problem);
  const StageTimes initial = estimator->last_times();
  engine->DownloadDepth(estimate);
  const double fast = whole.Elapsed();
  for (EngineView& source : problem.sources) source.estimate = estimate;
  problem.reference.estimate = estimate;
  double geometric = 0;
  for (size_t step = 1; step < estimator->schedule().size(); ++step) {
    problem.reference.estimate = estimator->Run(estimator->schedule()[step], problem);
    // The sources' maps must be of the scale that is matched.
    if (estimator->schedule()[step].kind == KeyframeStep::Kind::kNextScale) {
      for (EngineView& source : problem.sources) source.estimate = problem.reference.estimate;
    }
    geometric += estimator->last_times().kernels_ms;
  }
  stage.Lap();
  engine->Download(problem.reference.estimate);
  const double download = stage.Lap();
  engine->FilterByConsistency(problem.reference, problem.sources, options.fusion);
  const double consistency = stage.Lap();
  return {{"photometric", initial.photometric_kernels_ms},
          {"planar prior", initial.kernels_ms - initial.photometric_kernels_ms},
          {"geometric passes", geometric},
          {"kernels", initial.kernels_ms + geometric},
          {"triangulation", initial.prior_construction_ms},
          {"load", load},
          {"download", download},
          {"consistency", consistency},
          {"fast", fast},
          {"whole", whole.Elapsed()}};
}

/// Runs the stages on a textured wall seen by `source_views` + 1 cameras. Returns medians of the runs: ms per image, of
/// the passes the device's time where the engine measures it, and bytes on the device per pixel.
Figures MeasureStages(DepthEngine* engine, const PipelineOptions& options, ImageSize size, int source_views,
                      int repetitions) {
  const std::vector<FramePtr> frames = MakeFrames(size, source_views);
  EngineProblem problem;
  problem.reference.frame = frames[0];
  problem.depth_range = kRange;
  for (int i = 1; i <= source_views; ++i) {
    const FramePtr& frame = frames[static_cast<size_t>(i)];
    problem.sources.push_back({frame, engine->Load(frame, options.start_level), nullptr});
  }
  DepthEstimator estimator(engine, options);
  Figures figures = RunStages(engine, &estimator, options, problem, frames[0]);  // warms up
  std::vector<std::vector<double>> values(figures.size());
  for (int i = 0; i < repetitions; ++i) {
    const Figures run = RunStages(engine, &estimator, options, problem, frames[0]);
    for (size_t k = 0; k < run.size(); ++k) values[k].push_back(run[k].second);
  }
  for (size_t k = 0; k < figures.size(); ++k) figures[k].second = Quantile(std::move(values[k]), 0.5);
  figures.emplace_back("B/px", static_cast<double>(engine->DeviceBytes()) / size.width / size.height);
  return figures;
}

/// Feeds a camera that moves along a textured wall to a mapper with these options, live as in the nodelet: what waits
/// for idle time there is left out. Returns keyframes per second; ms from the colour image to on_fast, and to
/// on_refined of another keyframe; ms of device time per keyframe until its refined maps are out; keyframes that were
/// not refined again; memory after a tenth of the stream and at its end.
Figures MeasureStream(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size, int keyframes) {
  const int source_views = options.max_source_views;
  std::vector<double> fast, refined, device;
  // Since each image came; callbacks read those of images that came before them.
  std::vector<Timer> since_added(static_cast<size_t>(keyframes));
  const auto since = [&](int64_t id) { return since_added[static_cast<size_t>(id)].Elapsed(); };
  DenseMapper::Callbacks callbacks;
  callbacks.on_fast = [&](const KeyframeDepthPtr& maps) {
    if (maps->source_ids.size() == static_cast<size_t>(source_views)) fast.push_back(since(maps->frame->id));
  };
  callbacks.on_refined = [&](const KeyframeDepthPtr& maps) {
    if (maps->source_ids.size() < static_cast<size_t>(source_views)) return;
    refined.push_back(since(maps->frame->id + options.lookahead));
    device.push_back(maps->times.kernels_ms);
  };
  const std::unique_ptr<DepthEngine> output_engine = engine->Share();
  DenseMapper mapper(engine, options, callbacks, output_engine.get());

  WallStream stream(size, keyframes);
  size_t device_bytes = 0, host_bytes = 0;
  Timer work;
  for (int i = 0; i < keyframes; ++i) {
    FrameWithoutGray frame = stream.Next();
    since_added[static_cast<size_t>(i)] = Timer();
    mapper.AddKeyframe(frame.Make());
    if (i != keyframes / 10) continue;
    device_bytes = engine->DeviceBytes();
    host_bytes = HostBytes();
  }
  mapper.WaitForOutputs();
  const double rate = 1e3 * keyframes / work.Elapsed();
  const auto megabytes = [](size_t bytes) { return static_cast<double>(bytes) * 1e-6; };
  return {{"keyframes/s", rate},
          {"fast: median", Quantile(fast, 0.5)},
          {"99 %", Quantile(fast, 0.99)},
          {"refined: median", Quantile(refined, 0.5)},
          {"99 %", Quantile(refined, 0.99)},
          {"device", Quantile(device, 0.5)},
          {"not again", static_cast<double>(mapper.left_out().second_turns)},
          {"MB device: begin", megabytes(device_bytes)},
          {"end", megabytes(engine->DeviceBytes())},
          {"MB host: begin", megabytes(host_bytes)},
          {"end", megabytes(HostBytes())}};
}

struct BenchmarkArguments {
  std::vector<std::string> sizes;  ///< none: what the device does in some seconds
  std::vector<int> source_views = {10};
  int repetitions = 5;
  int keyframes = 0;
  DenseMapperOptions stream;
  std::vector<std::string> presets = {"balanced"};
  std::vector<std::string> set;
  std::string device = "auto";
  int cuda_index = 0;
};

ImageSize ParseSize(const std::string& text) {
  ImageSize size;
  char x = 0, rest = 0;
  std::istringstream stream(text);
  if (!(stream >> size.width >> x >> size.height) || x != 'x' || stream >> rest) {
    throw InvalidInputError(Concat("--sizes: \"", text, "\": must be WIDTHxHEIGHT, such as 640x480"));
  }
  CheckRange("--sizes: width", size.width, 16, 16384);
  CheckRange("--sizes: height", size.height, 16, 16384);
  return size;
}

/// A row of a table, with its head first. Each column is as wide as its title.
void PrintRow(const std::string& preset, const std::string& size, int source_views, const Figures& figures,
              bool with_head) {
  const auto width = [](const std::string& title) { return static_cast<int>(std::max<size_t>(title.size(), 8)) + 2; };
  if (with_head) {
    std::cout << std::left << std::setw(18) << "preset" << std::right << std::setw(10) << "size" << std::setw(4) << "V";
    for (const auto& [title, value] : figures) std::cout << std::setw(width(title)) << title;
    std::cout << "\n";
  }
  std::cout << std::left << std::setw(18) << preset << std::right << std::setw(10) << size << std::setw(4)
            << source_views;
  for (const auto& [title, value] : figures) std::cout << std::setw(width(title)) << value;
  std::cout << std::endl;
}

/// Each preset with each size and each number of source views.
void RunBenchmark(const BenchmarkArguments& arguments) {
  for (int source_views : arguments.source_views) CheckRange("--source-views", source_views, 1, kMaxSourceViews);
  const DepthEngineBackend backend = MakeDepthEngine(ParseDevice(arguments.device), arguments.cuda_index);
  DepthEngine* engine = backend.engine.get();
  const bool is_gpu = engine->FreeDeviceBytes() > 0;
  std::vector<std::string> sizes = arguments.sizes;
  if (sizes.empty()) sizes = is_gpu ? std::vector<std::string>{"640x480", "3072x2048"} : std::vector{"320x240"s};
  std::cout << "device " << engine->device_name();
  if (!backend.fallback_reason.empty()) std::cout << ", since " << backend.fallback_reason;
  const bool is_stream = arguments.keyframes > 0;
  std::cout << (is_stream ? Concat("\nonline mapper, ", arguments.keyframes, " keyframes with exact poses, ms\n")
                          : Concat("\nmedians of ", arguments.repetitions, " runs after one warm-up, ms per image\n"))
            << std::fixed << std::setprecision(2);
  bool is_first = true;
  for (const std::string& preset : arguments.presets) {
    PipelineOptions options = MakePreset(preset);
    for (const std::string& assignment : arguments.set) OptionsOf(&options).Set(assignment);
    Validate(options);
    for (const std::string& text : sizes) {
      const ImageSize size = ParseSize(text);
      for (int source_views : arguments.source_views) {
        Figures figures;
        if (is_stream) {
          // The window must be long enough for so many source views.
          DenseMapperOptions stream = arguments.stream;
          CheckRange("--window-size", stream.window_size, source_views + 1, kMaxWindowSize);
          stream.pipeline = options;
          stream.live = true;
          stream.max_source_views = source_views;
          stream.min_source_views = std::min(2, source_views);
          figures = MeasureStream(engine, stream, size, arguments.keyframes);
        } else {
          figures = MeasureStages(engine, options, size, source_views, arguments.repetitions);
        }
        PrintRow(preset, text, source_views, figures, std::exchange(is_first, false));
      }
    }
  }
}

}  // namespace
}  // namespace acmp

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  acmp::BenchmarkArguments arguments;
  CLI::App app(
      "Measures milliseconds per image of each stage on synthetic images. With --keyframes it feeds a stream of "
      "keyframes to the online mapper instead and reports how many per second it keeps up with, latency and memory. "
      "Times grow with the number of pixels.\n"
      "Example: acmp_benchmark --sizes 640x480,3072x2048 --source-views 6,10",
      "acmp_benchmark");
  app.option_defaults()->always_capture_default();
  app.add_option("--sizes", arguments.sizes, "Image sizes, WIDTHxHEIGHT")
      ->delimiter(',')
      ->default_str("640x480,3072x2048; on a CPU 320x240");
  app.add_option("--source-views", arguments.source_views, "Numbers of source views, 1..32")->delimiter(',');
  app.add_option("--repetitions", arguments.repetitions, "Runs per size")->check(CLI::Range(1, 1000));
  app.add_option("--keyframes", arguments.keyframes, "Length of the stream; 0: stages")->check(CLI::Range(0, 1000000));
  app.add_option("--window-size", arguments.stream.window_size,
                 "Of the stream: " + acmp::OptionsOf(&arguments.stream).Find("window_size").sentence)
      ->check(CLI::Range(2, acmp::kMaxWindowSize));
  arguments.stream.poses.refine = acmp::RefinePoses::kOff;  // the stream's are exact
  app.add_option("--preset", arguments.presets, "Presets, see docs/algorithm.md")
      ->delimiter(',')
      ->check(CLI::IsMember(acmp::PresetNames()));
  app.add_option("--set", arguments.set,
                 "NAME=VALUE: an option of the pipeline over the preset's, see docs/parameters.md")
      ->default_str("");
  app.add_option("--device", arguments.device, "auto, cuda or cpu");
  app.add_option("--cuda-index", arguments.cuda_index, "Which GPU");
  return acmp::RunTool(app, argc, argv, [&] {
    acmp::RunBenchmark(arguments);
    return acmp::Printed();
  });
}
