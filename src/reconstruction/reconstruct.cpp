#include "acmp_mapping/reconstruction/reconstruct.h"

#include <algorithm>
#include <future>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/colmap_workspace.h"
#include "plan.h"
#include "run.h"

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

/// Images that do not fit into memory are read more than once: where one has changed meanwhile, nobody knows what the
/// maps are of, and they are removed.
void CheckUnchanged(const Scene& scene, const std::vector<int>& indices, const std::vector<std::string>& files,
                    const StopRequest& interrupt, OutputFolder* folder) {
  const int changed = FindChangedImage(scene, indices, files, interrupt);
  if (changed < 0) return;
  folder->StartAfresh();
  throw ProcessingError(Concat(scene.images[static_cast<size_t>(changed)].path.string(),
                               ", its mask or its prior depth has changed during the run: what had been computed is "
                               "removed; run again with --overwrite when the images stay as they are"));
}

}  // namespace

void Reconstruct(const ReconstructOptions& options, const RunContext& context) {
  const Timer timer;
  Validate(options);
  CheckOutputIsNoInput(options);
  const bool plans = !options.plan.empty();
  std::future<std::vector<ReconstructDevice>> devices_to_come =
      std::async(plans ? std::launch::deferred : std::launch::async, context.make_devices);
  Scene scene = ReadSceneInput(options);
  Progress progress(&context.log, &context.out, options.quiet, context.log_is_terminal);
  StopRequest& interrupt = context.interrupt;
  for (const std::string& warning : scene.warnings) progress.Warn(warning);
  if (!scene.note.empty()) progress.Note(scene.note);
  const auto faces = std::count_if(scene.images.begin(), scene.images.end(),
                                   [](const SceneImage& image) { return image.face.has_value(); });
  if (faces > 0) progress.Note(Concat(faces, " of ", scene.images.size(), " images are faces of wide ones"));
  const std::vector<int> indices =
      TakeMasks(options, ParseImageIndices(options.images, static_cast<int>(scene.images.size())), scene, &progress);
  CheckPriorDepths(options, indices, scene, &progress);
  for (int index : options.colmap ? indices : std::vector<int>()) {
    CheckColmapName(scene.images[static_cast<size_t>(index)].name);
  }
  ReconstructPlan plan = MakePlan(scene, indices, options);
  interrupt.Check();
  for (const std::string& warning : plan.warnings) progress.Warn(warning);

  const std::optional<Lens> lens = RefineScenePoses(plan, options, interrupt, &scene, &progress);
  interrupt.Check();
  CheckSizes(scene, indices, options);
  FrameStore frames(scene, options.max_image_size, options.MemoryBytes(options.kImageShare));
  progress.Warn(DescribePoseDoubt(scene, plan, &frames));
  if (plans) return PlanStages(scene, plan, options, interrupt, &frames, &progress);
  progress.Note(Concat("checking ", indices.size(), " images"));
  // Each image is decoded once, so that a damaged one is found now and not hours later; those that fit in stay.
  const auto decode = [&](int index) { frames.Get(index); };
  const std::vector<std::string> files = HashFiles(scene, indices, interrupt, decode);
  const Devices devices(devices_to_come.get());
  const RunRecord record = MakeRecord(options, devices.name(), InputHash(scene, indices, files));
  OutputFolder folder(options.output, record, options.overwrite);
  if (folder.state() == OutputFolder::State::kComplete) {
    ReportComplete(folder, "", options, &progress);
    if (!options.mesh.empty()) WriteSceneMesh(options, plan.origin, folder, interrupt, &frames, &progress);
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
    folder.Claim({"camera.yaml"});
    WriteCalibration(
        folder.path() / "camera.yaml", *lens,
        "The camera of the images with the distortion that its calibration has left, as --refine-poses found it");
  }
  {
    ReconstructRun run{scene, options, plan, devices, frames, interrupt, progress, &folder};
    if (options.online()) RunOnlineSchedule(&run);
    ReportImagesWithoutMap(plan, scene, &progress);
    const size_t points = RunAndWriteResults(&run);
    CheckUnchanged(scene, indices, files, interrupt, &folder);
    EndRun(&run, record, devices.name(), timer, points);
  }
  if (!options.mesh.empty()) WriteSceneMesh(options, plan.origin, folder, interrupt, &frames, &progress);
}

}  // namespace acmp
