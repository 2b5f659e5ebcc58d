#include "acmp_mapping/reconstruction/reconstruct.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <future>
#include <numeric>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "image_files.h"
#include "input_hash.h"
#include "run_record.h"
#include "stages.h"

namespace acmp {
namespace {

/// A run removes what an earlier one has left in its folder: none of what it reads may be there.
void CheckOutputIsNoInput(const ReconstructOptions& options) {
  const std::filesystem::path output = std::filesystem::weakly_canonical(options.output);
  for (const auto& [name, folder] : {std::pair<const char*, std::filesystem::path>{"SCENE", options.scene},
                                     {"--masks", options.masks},
                                     {"--prior-depth", options.prior_depth}}) {
    if (folder.empty()) continue;
    const std::filesystem::path input = std::filesystem::weakly_canonical(folder);
    if (std::mismatch(output.begin(), output.end(), input.begin(), input.end()).first != output.end()) continue;
    throw InvalidInputError(Concat("OUTPUT = ", options.output.string(), ": holds ", name, " = ", folder.string(),
                                   ": must be another folder than one with input in it"));
  }
}

std::vector<int> ChosenImages(const Scene& scene, const std::string& list) {
  const int count = static_cast<int>(scene.images.size());
  if (!list.empty()) return ParseImageIndices(list, count);
  std::vector<int> all(count);
  std::iota(all.begin(), all.end(), 0);
  return all;
}

ReconstructPlan MakePlan(const Scene& scene, const std::vector<int>& indices, const ReconstructOptions& options) {
  if (options.online()) return MakeOnlinePlan(scene, indices);
  std::vector<std::optional<DepthRange>> ranges;
  ranges.reserve(indices.size());
  for (int index : indices) ranges.push_back(FindDepthRange(scene, index, options));
  return MakeOfflinePlan(scene, indices, ranges, options);
}

/// Reads every image once, so that a damaged one is found now and not hours later, and returns a hash of all input:
/// files, masks, cameras, poses, landmarks, ranges and source views.
std::string CheckInput(const Scene& scene, const std::vector<int>& indices, FrameStore* frames,
                       const StopRequest& interrupt) {
  std::vector<ImageHashes> hashes(indices.size());
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    frames->Get(indices[i]);  // those that fit in stay for the run
    hashes[i] = HashesOf(scene, indices[i]);
  });
  interrupt.Check();
  return InputHash(hashes);
}

/// Of the files of all images: what StampOfFiles says.
std::vector<uint64_t> StampsOf(const Scene& scene, const std::vector<int>& indices) {
  std::vector<uint64_t> stamps;
  stamps.reserve(indices.size());
  for (int index : indices) stamps.push_back(StampOfFiles(scene.images[static_cast<size_t>(index)]));
  return stamps;
}

/// Images that do not fit into memory are read more than once: where one has been written meanwhile, nobody knows what
/// the maps are of, and they are removed.
void CheckUnchanged(const Scene& scene, const std::vector<int>& indices, const std::vector<uint64_t>& stamps,
                    OutputFolder* folder) {
  const std::vector<uint64_t> now = StampsOf(scene, indices);
  const auto changed = static_cast<size_t>(std::mismatch(now.begin(), now.end(), stamps.begin()).first - now.begin());
  if (changed == now.size()) return;
  folder->StartAfresh();
  throw ProcessingError(Concat(scene.images[static_cast<size_t>(indices[changed])].path.string(),
                               ", its mask or its prior depth was written during the run: what had been computed is "
                               "removed; run again with --overwrite when the images stay as they are"));
}

/// Runs the schedule and writes the results.
CloudSize RunSchedule(ReconstructRun* run) {
  if (run->options.online()) RunOnlineSchedule(run);
  ReportImagesWithoutMap(run->plan, run->scene, &run->progress);
  const CloudSize cloud = RunAndWriteResults(run);
  run->interrupt.Check();
  ReportUnusedPriorDepth(*run);
  return cloud;
}

}  // namespace

void Reconstruct(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
                 std::ostream* out, std::ostream* log, bool log_is_terminal) {
  const Timer timer;
  Validate(options);
  if (!options.stage.empty()) {
    return DoStage(options, make_devices, interrupt, out, log, log_is_terminal);
  }
  CheckOutputIsNoInput(options);
  const bool plans = !options.plan.empty();
  std::future<std::vector<ReconstructDevice>> devices_to_come =
      std::async(plans ? std::launch::deferred : std::launch::async, make_devices);
  Scene scene = ReadScene(options.scene, ParseSceneFormat(options.format), ParsePixelCenters(options.pixel_centers),
                          options.image_path);
  Progress progress(log, ProgressStyleFor(options.quiet, log_is_terminal));
  for (const std::string& warning : scene.warnings) progress.Warn(warning);
  const std::vector<int> indices = TakeMasks(options, ChosenImages(scene, options.images), &scene, &progress);
  TakePriorDepths(options, indices, &scene, &progress);
  if (options.colmap) ColmapOutput::CheckNames(scene, indices);
  ReconstructPlan plan = MakePlan(scene, indices, options);
  interrupt->Check();
  for (const std::string& warning : plan.warnings) progress.Warn(warning);

  const std::optional<Lens> lens = RefineScenePoses(plan, options, *interrupt, &scene, &progress);
  interrupt->Check();
  CheckSizes(scene, indices, options);
  if (plans) return PlanStages(scene, plan, options, &progress, out);
  progress.Note(Concat("checking ", indices.size(), " images"));
  FrameStore frames(scene, MakeFrameOptions(options), options.MemoryBytes(options.kImageShare));
  const std::vector<uint64_t> stamps = StampsOf(scene, indices);
  const std::string input_hash = CheckInput(scene, indices, &frames, *interrupt);
  const Devices devices(devices_to_come.get(), indices);
  const RunRecord record = MakeRecord(options, devices.name(), input_hash);
  OutputFolder folder(options.output, record, options.overwrite);
  if (folder.state() == OutputFolder::State::kComplete) {
    if (!options.keep_work) folder.RemoveWork();
    ReportComplete(folder, options.output.string() + ": already complete (--overwrite starts afresh)", options.quiet,
                   out);
    if (!options.mesh.empty()) WriteSceneMesh(options, plan.origin, folder, *interrupt, &frames, &progress, out);
    return;
  }
  if (!folder.losses().empty()) {
    progress.Warn(Concat(options.output.string(), ": was complete, but ", folder.losses(), "; all is written again"));
  } else if (folder.state() == OutputFolder::State::kStarted) {
    progress.Note(options.online() ? "an interrupted run with --schedule online starts anew"
                                   : "going on with an interrupted run");
  }
  if (folder.state() == OutputFolder::State::kStarted && options.online()) folder.StartAfresh();
  if (lens) {
    WriteCalibration(
        folder.path() / "camera.yaml", *lens,
        "The camera of the images with the distortion that its calibration has left, as --refine-poses found it");
  }
  {
    EngineStore store(&frames, options, &folder, plan, devices, ScheduleOf(MakePipelineOptions(options)));
    ReconstructRun run{scene, options, plan, devices, store, *interrupt, progress, &folder};
    const CloudSize cloud = RunSchedule(&run);
    CheckUnchanged(scene, indices, stamps, &folder);
    const std::string failure = EndRun(&run, record, devices.name(), timer, cloud, out);
    if (!failure.empty()) throw ProcessingError(failure);
  }
  if (!options.mesh.empty()) WriteSceneMesh(options, plan.origin, folder, *interrupt, &frames, &progress, out);
}

}  // namespace acmp
