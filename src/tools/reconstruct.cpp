#include "reconstruct.h"

#include <future>
#include <map>
#include <numeric>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/output_file.h"
#include "reconstruct_colmap.h"
#include "reconstruct_run.h"
#include "reconstruct_summary.h"

namespace acmp {
namespace {

std::vector<int> ChosenImages(const Scene& scene, const std::string& list) {
  const int count = static_cast<int>(scene.images.size());
  if (!list.empty()) return ParseImageIndices(list, count);
  std::vector<int> all(count);
  std::iota(all.begin(), all.end(), 0);
  return all;
}

/// "NVIDIA H200 (cuda:0)" -> "NVIDIA H200": what decides the bits.
std::string DeviceModel(const std::string& device_name) { return device_name.substr(0, device_name.find(" (")); }

std::string Joined(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : " ") + word;
  return all.empty() ? "nothing" : all;
}

/// Everything that decides the bits of the results, and which files there are.
RunRecord MakeRecord(const ReconstructOptions& options, const std::string& device, const std::string& input_hash) {
  const auto depth = [](const std::optional<double>& value) { return value ? Concat(*value) : std::string("auto"); };
  const auto flag = [](bool value) { return std::string(value ? "yes" : "no"); };
  RunRecord record = {{"version", ACMP_VERSION},
                      {"input (hash of images, cameras, poses, landmarks)", input_hash},
                      {"device", DeviceModel(device)},
                      {"preset", options.preset},
                      {"set", Joined(options.set)},
                      {"schedule", options.schedule},
                      {"max-image-size", Concat(options.max_image_size)},
                      {"source-views", Concat(options.source_views)},
                      {"min-source-views", Concat(MinSourceViews(options))},
                      {"depth-min", depth(options.depth_min)},
                      {"depth-max", depth(options.depth_max)},
                      {"seed", Concat(options.seed)},
                      {"maps", Joined(options.maps)},
                      {"dmb", flag(options.dmb)},
                      {"colmap", flag(options.colmap)},
                      {"pictures", flag(!options.no_pictures)}};
  if (options.online()) {
    record.emplace_back("window-size", Concat(options.window_size));
    record.emplace_back("lookahead", Concat(options.lookahead));
    record.emplace_back("reestimates", Concat(options.reestimates));
    record.emplace_back("refine-again", flag(options.refine_again));
  }
  return record;
}

ProgressStyle StyleFor(const ReconstructOptions& options, bool log_is_terminal) {
  if (options.quiet) return ProgressStyle::kSilent;
  return log_is_terminal ? ProgressStyle::kBar : ProgressStyle::kLines;
}

void ReportImagesWithoutMap(const ReconstructRun& run) {
  for (const ImagePlan& image : run.plan.images) {
    if (!image.no_map.empty()) {
      run.progress.Warn(Concat("no map for image ", run.scene.images[image.index].name, ": ", image.no_map));
    }
  }
}

void RunAllSteps(ReconstructRun* run, const RunRecord& record, const Timer& timer, std::ostream* out) {
  TaskGraph graph;
  std::map<int, int> final_maps;
  if (run->options.online()) {
    RunOnlineSchedule(run);
  } else {
    final_maps = AddOfflineSchedule(run, &graph);
  }
  ReportImagesWithoutMap(*run);
  const size_t points = RunAndWriteResults(run, final_maps, &graph);
  run->interrupt.Check();
  Timer sync;
  SyncFolder(run->folder.path());
  run->times.syncing_ms += sync.Lap();
  run->times.run_ms = timer.Elapsed();
  WriteFileAtomically(run->folder.SummaryFile(),
                      FormatSummary(*run, record, run->engines.front().engine->device_name(), points),
                      Durability::kPowerCut);
  if (!run->options.keep_work) run->folder.RemoveAllWork();
  if (!run->options.quiet) {
    *out << run->folder.path().string() << ": " << points << " points in fused.ply; took "
         << FormatDuration(run->times.run_ms / 1000) << " on " << run->engines.front().engine->device_name()
         << std::endl;
  }
  if (run->options.timings) *out << FormatTimings(run->times) << std::flush;
}

}  // namespace

void Reconstruct(const ReconstructOptions& options, const EngineMaker& make_engines, InterruptWatcher* interrupt,
                 std::ostream* out, std::ostream* log, bool log_is_terminal) {
  const Timer timer;
  Validate(options);
  std::future<std::vector<ReconstructEngine>> engines_to_come = std::async(std::launch::async, make_engines);
  const Scene scene = ReadScene(options.scene, ParseSceneFormat(options.format));
  const std::vector<int> indices = ChosenImages(scene, options.images);
  if (options.colmap) ColmapOutput::CheckNames(scene, indices);
  ReconstructPlan plan = options.online() ? MakeOnlinePlan(indices) : MakeOfflinePlan(scene, indices, options);
  interrupt->Check();
  Progress progress(log, StyleFor(options, log_is_terminal), TotalCost(plan, MakePipelineOptions(options)));
  for (const std::string& warning : scene.warnings) progress.Warn(warning);
  for (const std::string& warning : plan.warnings) progress.Warn(warning);

  progress.Note(Concat("checking ", indices.size(), " images"));
  FrameStore frames(scene, MakeFrameOptions(options), options.MemoryBytes(options.kImageShare));
  const std::string input_hash = CheckInput(scene, indices, &frames, *interrupt);
  const std::vector<ReconstructEngine> engines = engines_to_come.get();
  const RunRecord record = MakeRecord(options, engines.front().engine->device_name(), input_hash);
  const ReconstructFolder folder(options.output, record, options.overwrite);
  if (folder.state() == ReconstructFolder::State::kComplete) {
    if (!options.keep_work) folder.RemoveAllWork();
    if (!options.quiet)
      *out << options.output.string() << ": already complete (--overwrite starts afresh)" << std::endl;
    return;
  }
  if (folder.state() == ReconstructFolder::State::kStarted) progress.Note("going on with an interrupted run");
  EngineStore store(&frames, options, folder, plan, engines);
  ReconstructRun run{scene, options, plan, folder, engines, store, *interrupt, progress, {}, {}};
  RunAllSteps(&run, record, timer, out);
}

}  // namespace acmp
