#include "benchmark_stages.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <opencv2/imgproc.hpp>

#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/mapping/auto_preset.h"

namespace acmp {
namespace {

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
FramePtr MakeWallFrame(const cv::Mat& texture, const FrameOptions& options, int64_t id, double x, double y) {
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
      MakeFrame(id, 0.0, std::move(color), camera, cam_from_world, std::move(landmarks), options));
}

/// Sources lie at alternating sides, about 5 degrees of triangulation angle apart.
std::vector<FramePtr> MakeFrames(ImageSize size, const FrameOptions& options, int source_views) {
  const cv::Mat texture = MakeTexture(size);
  std::vector<FramePtr> frames = {MakeWallFrame(texture, options, 0, 0, 0)};
  for (int i = 1; i <= source_views; ++i) {
    frames.push_back(
        MakeWallFrame(texture, options, i, (i % 2 == 0 ? 1 : -1) * (0.5 + 0.08 * i), (i % 4 < 2 ? 1 : -1) * 0.3));
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
      frames_.push_back(MakeWallFrame(texture, {}, i, kStep * i, i % 2 == 0 ? 0.0 : 0.2));
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

}  // namespace

Figures MeasureStages(DepthEngine* engine, const PipelineOptions& options, ImageSize size, int source_views,
                      int repetitions) {
  const std::vector<FramePtr> frames = MakeFrames(size, {}, source_views);
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

Figures MeasureStream(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size, int keyframes) {
  const int source_views = options.source_views.max_source_views;
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
          {"MB device: begin", megabytes(device_bytes)},
          {"end", megabytes(engine->DeviceBytes())},
          {"MB host: begin", megabytes(host_bytes)},
          {"end", megabytes(HostBytes())}};
}

std::vector<ExpectedRates> MeasureExpectedRates(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size,
                                                int keyframes) {
  constexpr ImageSize kSizes[] = {{320, 240}, {480, 360}, {640, 480}, {960, 720}, {1280, 960}};
  std::vector<ExpectedRates> expected;
  for (const std::string& preset : PresetNames()) {
    DenseMapperOptions of_preset = options;
    of_preset.pipeline = MakePreset(preset);
    if (of_preset.pipeline.multi_scale) continue;  // offline only
    ExpectedRates rates = {preset, MeasureStream(engine, of_preset, size, keyframes).front().second, {}};
    for (const ImageSize& other : kSizes) {
      const double pixels = static_cast<double>(other.width) * other.height / size.width / size.height;
      rates.computed.emplace_back(other, rates.measured / pixels);
    }
    expected.push_back(std::move(rates));
  }
  return expected;
}

std::vector<std::string> MeasureAutoPreset(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size,
                                           double interval_s) {
  constexpr int kDistinct = 64;
  const std::unique_ptr<DepthEngine> output_engine = engine->Share();
  std::vector<std::string> choices;
  AutoPreset choice;
  while (!choice.is_settled()) {
    const AutoPreset::Setting& setting = choice.setting();
    DenseMapperOptions of_setting = options;
    of_setting.pipeline = MakePreset(setting.preset);
    of_setting.source_views.max_source_views =
        std::min(options.source_views.max_source_views, setting.max_source_views);
    DenseMapper mapper(engine, of_setting, {}, output_engine.get());
    const auto scaled = [&](int pixels) { return std::max(1, static_cast<int>(std::lround(setting.size * pixels))); };
    WallStream stream({scaled(size.width), scaled(size.height)}, kDistinct);
    std::optional<std::string> said;
    while (!said) {
      FrameWithoutGray frame = stream.Next();
      Timer timer;
      mapper.AddKeyframe(frame.Make());
      said = choice.Add(timer.Elapsed(), interval_s);
    }
    mapper.WaitForOutputs();
    choices.push_back(std::move(*said));
  }
  return choices;
}

}  // namespace acmp
