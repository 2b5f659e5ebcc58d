// Time per stage of Algorithm 1 on synthetic images of given sizes, and its ratio to the texture floor.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mapping/window_options.h"
#include "benchmark_stages.h"
#include "tool_main.h"
#ifdef ACMP_HAVE_CUDA
#include "acmp_mapping/backend/texture_rate.h"
#endif

namespace acmp {
namespace {

struct BenchmarkArguments {
  std::vector<std::string> sizes;  ///< none: what the device does in some seconds
  std::vector<int> source_views = {10};
  int repetitions = 5;
  int keyframes = 0;
  bool expect = false;
  double auto_interval_s = 0;
  DenseMapperOptions stream;
  std::string preset = "balanced";
  std::vector<std::string> set;
  std::string device = "auto";
  int cuda_index = 0;
  int multiprocessors = 0;
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

void RunBenchmark(const BenchmarkArguments& arguments) {
  DepthEngineBackend backend =
      MakeDepthEngine(ParseDevice(arguments.device), arguments.cuda_index, arguments.multiprocessors);
  const bool is_gpu = backend.engine->device_name().find("cuda") != std::string::npos;
  if (arguments.multiprocessors > 0 && !is_gpu) {
    throw InvalidInputError(Concat("--sms ", arguments.multiprocessors, ": the CPU has no multiprocessors",
                                   backend.fallback_reason.empty() ? "" : "; ", backend.fallback_reason));
  }
  BenchmarkReport report;
  report.device = backend.engine->device_name();
  report.preset = arguments.preset;
  report.repetitions = arguments.repetitions;
  std::vector<std::string> sizes = arguments.sizes;
  if (sizes.empty())
    sizes = is_gpu ? std::vector<std::string>{"640x480", "3072x2048"} : std::vector<std::string>{"320x240"};
  std::cout << "device " << report.device;
  if (!backend.fallback_reason.empty()) std::cout << ", since " << backend.fallback_reason;
  std::cout << std::endl;
#ifdef ACMP_HAVE_CUDA
  if (is_gpu) {
    report.fetches_per_s = MeasureTextureRate(arguments.cuda_index, arguments.multiprocessors);
  }
#endif
  const auto stream_options = [&](int source_views) {
    DenseMapperOptions stream = arguments.stream;
    CheckRange("--window-size", stream.window_size, source_views + 1, kMaxWindowSize);
    stream.source_views.max_source_views = source_views;
    stream.min_source_views = std::min(2, source_views);
    return stream;
  };
  if (arguments.expect) {
    const int source_views = arguments.source_views.front();
    CheckRange("--source-views", source_views, 1, kMaxSourceViews);
    // Small enough for a short run, and large enough for its pixels to be what takes the time.
    const ImageSize size = is_gpu ? ImageSize{640, 480} : ImageSize{64, 48};
    const int keyframes = is_gpu ? 100 : 2 * source_views;
    report.expected = MeasureExpectedRates(backend.engine.get(), stream_options(source_views), size, keyframes);
  }
  if (arguments.auto_interval_s > 0) {
    const int source_views = arguments.source_views.front();
    CheckRange("--source-views", source_views, 1, kMaxSourceViews);
    report.auto_choices = MeasureAutoPreset(backend.engine.get(), stream_options(source_views),
                                            ParseSize(sizes.front()), arguments.auto_interval_s);
  }
  PipelineOptions options = MakePreset(arguments.preset);
  for (const std::string& assignment : arguments.set) OptionsOf(&options).Set(assignment);
  Validate(options);
  for (const std::string& text :
       arguments.expect || arguments.auto_interval_s > 0 ? std::vector<std::string>() : sizes) {
    const ImageSize size = ParseSize(text);
    for (int source_views : arguments.source_views) {
      CheckRange("--source-views", source_views, 1, kMaxSourceViews);
      if (arguments.keyframes > 0) {
        DenseMapperOptions stream = stream_options(source_views);
        stream.pipeline = options;
        report.streams.push_back(MeasureStream(backend.engine.get(), stream, size, arguments.keyframes));
      } else {
        report.stages.push_back(
            MeasureStages(backend.engine.get(), options, size, source_views, arguments.repetitions));
      }
    }
  }
  PrintReport(report, &std::cout);
}

}  // namespace
}  // namespace acmp

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  acmp::BenchmarkArguments arguments;
  CLI::App app(
      "Measures milliseconds per image of each stage on synthetic images, and on a GPU the ratio to the floor: one "
      "texture fetch per sample of the full schedule, at the fetch rate measured on the same GPU. With --keyframes it "
      "feeds a stream of keyframes to the online mapper instead and reports latency, rate and memory. With --expect it "
      "says how many keyframes per second each preset keeps up with at which size.\n"
      "Example: acmp_benchmark --sizes 640x480,3072x2048 --source-views 6,10",
      "acmp_benchmark");
  app.add_option("--sizes", arguments.sizes, "Image sizes, WIDTHxHEIGHT")
      ->delimiter(',')
      ->default_str("640x480,3072x2048; on a CPU 320x240");
  app.add_option("--source-views", arguments.source_views, "Numbers of source views, 1..32")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--repetitions", arguments.repetitions, "Runs per size")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--keyframes", arguments.keyframes, "Length of the stream; 0: stages")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  const acmp::OptionList stream_options = acmp::OptionsOf(&arguments.stream);
  app.add_option("--window-size", arguments.stream.window_size,
                 "Of the stream: " + stream_options.Find("window_size").sentence)
      ->check(CLI::Range(2, acmp::kMaxWindowSize))
      ->capture_default_str();
  app.add_option("--refine-again", arguments.stream.refine_again,
                 "Of the stream: " + stream_options.Find("refine_again").sentence)
      ->capture_default_str();
  const acmp::Option& refine_poses = stream_options.Find("refine_poses");
  arguments.stream.poses.refine = acmp::RefinePoses::kOff;  // the stream's are exact
  app.add_option_function<std::string>("--refine-poses", refine_poses.set, "Of the stream: " + refine_poses.sentence)
      ->check(CLI::IsMember(refine_poses.choices))
      ->default_str("off");
  app.add_option("--preset", arguments.preset, "Preset, see docs/algorithm.md")
      ->check(CLI::IsMember(acmp::PresetNames()))
      ->capture_default_str();
  app.add_option("--set", arguments.set,
                 "NAME=VALUE: an option of the pipeline over the preset's, see docs/parameters.md");
  CLI::Option* expect = app.add_flag(
      "--expect", arguments.expect,
      "Measure a short stream of each preset and compute the rate at other sizes (with the first of --source-views)");
  for (const char* other : {"--sizes", "--keyframes", "--repetitions", "--preset", "--set"}) expect->excludes(other);
  CLI::Option* auto_preset =
      app.add_option(
             "--auto", arguments.auto_interval_s,
             "What preset: auto chooses for keyframes that come every so many seconds, with the first of --sizes as "
             "max_image_size and the first of --source-views at most")
          ->check(CLI::PositiveNumber);
  for (const char* other : {"--expect", "--keyframes", "--repetitions", "--preset", "--set"})
    auto_preset->excludes(other);
  app.add_option("--device", arguments.device, "auto, cuda or cpu")->capture_default_str();
  app.add_option("--cuda-index", arguments.cuda_index, "Which GPU")->capture_default_str();
  app.add_option("--sms", arguments.multiprocessors,
                 "Use so many multiprocessors of the GPU (CUDA 12.5), to see how long a smaller GPU takes; 0: all")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  return acmp::RunTool(app, argc, argv, [&] {
    acmp::RunBenchmark(arguments);
    return acmp::Printed();
  });
}
