#include "acmp_mapping/reconstruction/reconstruct.h"

#include <future>
#include <map>
#include <numeric>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/output_file.h"
#include "colmap_output.h"
#include "run.h"
#include "scene_masks.h"
#include "scene_mesh.h"
#include "scene_pose_refinement.h"
#include "summary.h"

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

std::string RefinePosesName(const ReconstructOptions& options) {
  return std::get<std::string>(PoseRefinementOptionTable().Find("refine_poses").get(options.pose_refinement));
}

/// Everything that decides the bits of the results, and which files there are.
RunRecord MakeRecord(const ReconstructOptions& options, const std::string& device, const std::string& input_hash) {
  const auto depth = [](const std::optional<double>& value) { return value ? Concat(*value) : std::string("auto"); };
  const auto flag = [](bool value) { return std::string(value ? "yes" : "no"); };
  RunRecord record = {{"version", ACMP_VERSION},
                      {"input (hash of images, masks, cameras, poses, landmarks)", input_hash},
                      {"device", DeviceModel(device)},
                      {"preset", options.preset},
                      {"set", Joined(options.set)},
                      {"schedule", options.schedule},
                      {"max-image-size", Concat(options.max_image_size)},
                      {"source-views", Concat(options.source_views)},
                      {"min-source-views", Concat(MinSourceViews(options))},
                      {"depth-min", depth(options.depth_min)},
                      {"depth-max", depth(options.depth_max)},
                      {"refine-poses", RefinePosesName(options)},
                      {"seed", Concat(options.seed)},
                      {"maps", Joined(options.maps)},
                      {"dmb", flag(options.dmb)},
                      {"colmap", flag(options.colmap)},
                      {"pictures", flag(!options.no_pictures)}};
  if (options.online()) {
    record.emplace_back("window-size", Concat(options.window_size));
    record.emplace_back("lookahead", Concat(options.lookahead));
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

/// Runs the schedule and writes the results. Returns the number of points.
size_t RunSchedule(ReconstructRun* run) {
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
  return points;
}

/// Warns when hardly any pixel became a point. Returns why the run counts as failed: none did, though enough images
/// have maps for it. Empty: it does not.
std::string JudgePoints(const ReconstructRun& run, size_t points) {
  constexpr double kHardlyAny = 0.01;
  constexpr char kCauses[] =
      ": poses, cameras (made for images of this size?) or the range of depths may be wrong, or images too small; "
      "confidence/ and cost/ show where";
  int64_t pixels = 0;
  int images = 0;
  for (const ImagePlan& image : run.plan.images) {
    if (!image.no_map.empty()) continue;
    const PinholeCamera camera = CameraOf(run, image.index);
    pixels += static_cast<int64_t>(camera.width) * camera.height;
    ++images;
  }
  const int views = MakePipelineOptions(run.options).fusion.min_consistent_views;
  if (images <= views) {
    if (points == 0)
      run.progress.Warn(Concat("no points: for one ", views, " source views must agree, and ", images,
                               " images have maps (--set min_consistent_views)"));
    return "";
  }
  if (points == 0) {
    return Concat(run.folder.path().string(), ": none of the ", pixels, " pixels became a point", kCauses);
  }
  if (static_cast<double>(points) < kHardlyAny * static_cast<double>(pixels)) {
    run.progress.Warn(Concat("only ", points, " of ", pixels, " pixels became points", kCauses));
  }
  return "";
}

/// The summary, which makes the run complete.
void Finish(ReconstructRun* run, const RunRecord& record, const Timer& timer, size_t points, std::ostream* out) {
  Timer sync;
  run->folder.WriteFileList();
  SyncFolder(run->folder.path());
  run->times.syncing_ms = sync.Lap();
  run->times.run_ms = timer.Elapsed();
  const std::string failure = JudgePoints(*run, points);
  WriteFileAtomically(run->folder.SummaryFile(), FormatSummary(*run, record, run->devices.name(), points, failure),
                      Durability::kPowerCut);
  if (!run->options.keep_work) run->folder.RemoveWork();
  if (!run->options.quiet) {
    *out << run->folder.path().string() << ": " << points << " points in fused.ply; took "
         << FormatDuration(run->times.run_ms / 1000) << " on " << run->devices.name() << std::endl;
  }
  if (run->options.timings) *out << FormatTimings(run->times) << std::flush;
  if (!failure.empty()) throw ProcessingError(failure);
}

}  // namespace

void Reconstruct(const ReconstructOptions& options, const DeviceMaker& make_devices, InterruptWatcher* interrupt,
                 std::ostream* out, std::ostream* log, bool log_is_terminal) {
  const Timer timer;
  Validate(options);
  std::future<std::vector<ReconstructDevice>> devices_to_come = std::async(std::launch::async, make_devices);
  Scene scene = ReadScene(options.scene, ParseSceneFormat(options.format), ParsePixelCenters(options.pixel_centers));
  Progress progress(log, StyleFor(options, log_is_terminal));
  for (const std::string& warning : scene.warnings) progress.Warn(warning);
  const std::vector<int> indices = TakeMasks(options, ChosenImages(scene, options.images), &scene, &progress);
  if (options.colmap) ColmapOutput::CheckNames(scene, indices);
  ReconstructPlan plan = options.online() ? MakeOnlinePlan(indices) : MakeOfflinePlan(scene, indices, options);
  interrupt->Check();
  for (const std::string& warning : plan.warnings) progress.Warn(warning);

  RefineScenePoses(plan, options, *interrupt, &scene, &progress);
  interrupt->Check();
  progress.Note(Concat("checking ", indices.size(), " images"));
  FrameStore frames(scene, MakeFrameOptions(options), options.MemoryBytes(options.kImageShare));
  const std::string input_hash =
      CheckInput(scene, indices, MakePipelineOptions(options).start_level, &frames, *interrupt);
  const Devices devices(devices_to_come.get(), indices);
  const RunRecord record = MakeRecord(options, devices.name(), input_hash);
  OutputFolder folder(options.output, record, options.overwrite);
  if (folder.state() == OutputFolder::State::kComplete) {
    if (!options.keep_work) folder.RemoveWork();
    if (!options.quiet)
      *out << options.output.string() << ": already complete (--overwrite starts afresh)" << std::endl;
    const std::string failure = FailureOfSummary(folder.SummaryFile());
    if (!failure.empty()) throw ProcessingError(failure);
    if (!options.mesh.empty()) WriteSceneMesh(options, folder, *interrupt, &frames, &progress, out);
    return;
  }
  if (!folder.losses().empty()) {
    progress.Warn(Concat(options.output.string(), ": was complete, but ", folder.losses(), "; all is written again"));
  } else if (folder.state() == OutputFolder::State::kStarted) {
    progress.Note(options.online() ? "an interrupted run with --schedule online starts anew"
                                   : "going on with an interrupted run");
  }
  if (folder.state() == OutputFolder::State::kStarted && options.online()) folder.StartAfresh();
  {
    EngineStore store(&frames, options, folder, plan, devices, ScheduleOf(MakePipelineOptions(options)));
    ReconstructRun run{scene, options, plan, folder, devices, store, *interrupt, progress, {}, {}};
    const size_t points = RunSchedule(&run);
    Finish(&run, record, timer, points, out);
  }
  if (!options.mesh.empty()) WriteSceneMesh(options, folder, *interrupt, &frames, &progress, out);
}

}  // namespace acmp
