// Time per stage of Algorithm 1 on synthetic images of given sizes, or of a stream through the online mapper.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iomanip>
#include <iostream>
#include <utility>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "benchmark_stages.h"
#include "tool_main.h"

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

std::string Name(const ImageSize& size) { return Concat(size.width, "x", size.height); }

/// A row of a table, with its head first. Each column is as wide as its title.
void PrintRow(const std::string& size, int source_views, const Figures& figures, bool with_head) {
  const auto width = [](const std::string& title) { return static_cast<int>(std::max<size_t>(title.size(), 8)) + 2; };
  if (with_head) {
    std::cout << std::setw(10) << "size" << std::setw(4) << "V";
    for (const auto& [title, value] : figures) std::cout << std::setw(width(title)) << title;
    std::cout << "\n";
  }
  std::cout << std::setw(10) << size << std::setw(4) << source_views;
  for (const auto& [title, value] : figures) std::cout << std::setw(width(title)) << value;
  std::cout << std::endl;
}

/// @param size,keyframes,source_views of what was measured
void PrintExpected(const std::vector<ExpectedRates>& expected, const ImageSize& size, int keyframes, int source_views) {
  std::cout << "keyframes per second that the online mapper keeps up with, " << source_views
            << " source views, 4:3 images\n"
            << "  measured: at " << Name(size) << ", " << keyframes
            << " keyframes with exact poses; what refine_poses takes is not in it\n"
            << "  computed: all other sizes, as the time grows with the number of pixels (within a fifth)\n"
            << std::left << std::setw(18) << "preset" << std::right << std::setw(18) << Name(size) + " measured";
  for (const auto& [other, rate] : expected.front().computed) std::cout << std::setw(10) << Name(other);
  std::cout << "\n" << std::setprecision(3) << std::defaultfloat;
  for (const ExpectedRates& row : expected) {
    std::cout << std::left << std::setw(18) << row.preset << std::right << std::setw(18) << row.measured;
    for (const auto& [other, rate] : row.computed) std::cout << std::setw(10) << rate;
    std::cout << "\n";
  }
}

/// Of the stream, which must be as long as its window for so many source views.
DenseMapperOptions StreamOptions(const BenchmarkArguments& arguments, int source_views) {
  DenseMapperOptions stream = arguments.stream;
  CheckRange("--window-size", stream.window_size, source_views + 1, kMaxWindowSize);
  stream.source_views.max_source_views = source_views;
  stream.min_source_views = std::min(2, source_views);
  return stream;
}

/// Each size with each number of source views.
void MeasureSizes(const BenchmarkArguments& arguments, DepthEngine* engine) {
  PipelineOptions options = MakePreset(arguments.preset);
  for (const std::string& assignment : arguments.set) OptionsOf(&options).Set(assignment);
  Validate(options);
  if (arguments.keyframes > 0) {
    std::cout << "online mapper, preset " << arguments.preset << ", " << arguments.keyframes << " keyframes, ms\n";
  } else {
    std::cout << "medians of " << arguments.repetitions << " runs after one warm-up, ms per image, preset "
              << arguments.preset << "\n";
  }
  bool is_first = true;
  for (const std::string& text : arguments.sizes) {
    const ImageSize size = ParseSize(text);
    for (int source_views : arguments.source_views) {
      Figures figures;
      if (arguments.keyframes == 0) {
        figures = MeasureStages(engine, options, size, source_views, arguments.repetitions);
      } else {
        DenseMapperOptions stream = StreamOptions(arguments, source_views);
        stream.pipeline = options;
        figures = MeasureStream(engine, stream, size, arguments.keyframes);
      }
      PrintRow(text, source_views, figures, std::exchange(is_first, false));
    }
  }
}

void RunBenchmark(BenchmarkArguments arguments) {
  for (int source_views : arguments.source_views) CheckRange("--source-views", source_views, 1, kMaxSourceViews);
  const DepthEngineBackend backend = MakeDepthEngine(ParseDevice(arguments.device), arguments.cuda_index);
  DepthEngine* engine = backend.engine.get();
  const bool is_gpu = engine->FreeDeviceBytes() > 0;
  if (arguments.sizes.empty()) {
    arguments.sizes = is_gpu ? std::vector<std::string>{"640x480", "3072x2048"} : std::vector<std::string>{"320x240"};
  }
  std::cout << "device " << engine->device_name();
  if (!backend.fallback_reason.empty()) std::cout << ", since " << backend.fallback_reason;
  std::cout << std::endl << std::fixed << std::setprecision(2);
  const int source_views = arguments.source_views.front();
  if (arguments.expect) {
    // Small enough for a short run, and large enough for its pixels to be what takes the time.
    const ImageSize size = is_gpu ? ImageSize{640, 480} : ImageSize{64, 48};
    const int keyframes = is_gpu ? 100 : 2 * source_views;
    PrintExpected(MeasureExpectedRates(engine, StreamOptions(arguments, source_views), size, keyframes), size,
                  keyframes, source_views);
  } else if (arguments.auto_interval_s > 0) {
    const ImageSize size = ParseSize(arguments.sizes.front());
    for (const std::string& choice :
         MeasureAutoPreset(engine, StreamOptions(arguments, source_views), size, arguments.auto_interval_s)) {
      std::cout << choice << "\n";
    }
  } else {
    MeasureSizes(arguments, engine);
  }
}

}  // namespace
}  // namespace acmp

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  acmp::BenchmarkArguments arguments;
  CLI::App app(
      "Measures milliseconds per image of each stage on synthetic images. With --keyframes it feeds a stream of "
      "keyframes to the online mapper instead and reports latency, rate and memory. With --expect it says how many "
      "keyframes per second each preset keeps up with at which size.\n"
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
  app.add_option("--window-size", arguments.stream.window_size,
                 "Of the stream: " + acmp::OptionsOf(&arguments.stream).Find("window_size").sentence)
      ->check(CLI::Range(2, acmp::kMaxWindowSize))
      ->capture_default_str();
  arguments.stream.poses.refine = acmp::RefinePoses::kOff;  // the stream's are exact
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
  return acmp::RunTool(app, argc, argv, [&] {
    acmp::RunBenchmark(arguments);
    return acmp::Printed();
  });
}
