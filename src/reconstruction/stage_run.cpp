#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/pipeline/presets.h"
#include "outputs.h"
#include "plan.h"
#include "run.h"
#include "stages.h"
#include "work_files.h"

namespace acmp {
namespace {

constexpr int kExitFailed = 1, kExitBadInput = 2;  // as the program's

/// Does stages, one after the other. Devices, the plan and images are kept from one to the next: images within their
/// share of the memory limit.
class StageRunner {
 public:
  /// Devices are made when a stage needs them.
  StageRunner(const ReconstructOptions& options, const RunContext& context)
      : options_(options),
        context_(context),
        interrupt_(context.interrupt),
        steps_(ScheduleOf(MakePipelineOptions(options))),
        final_step_(static_cast<int>(steps_.size()) - 1) {
    options_.keep_work = true;  // everything in files: no process can count on the memory of another
  }

  /// After a failure it is not to be used again.
  void Run(const std::string& stage, const std::string& images) {
    options_.stage = stage;
    options_.images = images;
    RunStage();
    folder_.reset();
  }

 private:
  void RunStage() {
    const std::string name = options_.output.string();
    if (!OutputFolder::Exists(options_.output)) throw InvalidInputError(name + ": has no plan: give --plan first");
    folder_.emplace(options_.output, SettingsRecord(options_), false, OutputFolder::Use::kStages);
    const std::string chunk_images = folder_->Setting(kChunkImagesKey);
    const bool is_staged = chunk_images == Concat(options_.chunk_images);
    if (folder_->state() == OutputFolder::State::kComplete && !(is_staged && options_.stage == kFinishStage)) {
      return ReportComplete(*folder_, name + ": already complete", options_.quiet, &context_.out);
    }
    if (!is_staged) {
      throw InvalidInputError(
          Concat("--chunk-images ", options_.chunk_images, ": the plan in ", name, " has ", chunk_images));
    }
    const std::string input = folder_->Setting(kInputKey);
    if (!planned_ || input_ != input) planned_ = std::make_unique<PlannedScene>(options_);
    input_ = input;
    progress_.emplace(&context_.log, ProgressStyleFor(options_.quiet, context_.log_is_terminal));
    if (options_.stage == kFinishStage) return Finish();
    Choose();
    if (options_.stage == kMapsStage) return WriteMaps();
    if (options_.stage == kFuseStage) return Fuse();
    for (int step = 0; step <= final_step_; ++step) {
      if (options_.stage == EngineStore::StepName(step, final_step_)) {
        return DoWork(step, targets_, 0, [](ReconstructRun*, RunTasks* tasks) { tasks->Run(); });
      }
    }
    std::string names;
    for (const std::string& known : StagesOfChunk(options_)) names += known + ", ";
    throw InvalidInputError(Concat("--stage ", options_.stage, ": must be one of ", names, kFinishStage));
  }

  /// Takes the images of the range that take part.
  void Choose() {
    if (options_.images.empty()) throw InvalidInputError("--stage: needs --images");
    chosen_.clear();
    targets_.clear();
    for (int index : ParseImageIndices(options_.images, static_cast<int>(planned_->scene.images.size()))) {
      const ImagePlan* image = planned_->plan.Find(index);
      if (!image) continue;
      chosen_.insert(index);
      if (image->no_map.empty()) targets_.insert(index);
    }
    if (chosen_.empty()) {
      throw InvalidInputError(Concat("--images ", options_.images, ": the plan has none of these images"));
    }
  }

  /// Throws InvalidInputError unless the chosen images are what they were when they were planned.
  void CheckContent() const {
    const std::vector<int> indices(chosen_.begin(), chosen_.end());
    const std::vector<uint64_t> now = HashFiles(planned_->scene, indices, interrupt_, [](int) {});
    for (size_t i = 0; i < indices.size(); ++i) {
      if (now[i] == planned_->files.at(indices[i])) continue;
      throw InvalidInputError(
          Concat("image ", planned_->NameOf(indices[i]),
                 ": it, its mask or its prior depth has changed since it was planned: plan with --overwrite"));
    }
  }

  /// Does the steps that are missing before images have estimates of a step, by tasks that work(run, tasks) may add to
  /// and runs.
  /// @param read the images, by scene index
  /// @param more steps of the progress
  template <class Work>
  void DoWork(int step, const std::set<int>& read, size_t more, const Work& work) {
    CheckContent();
    const std::set<StepOfImage> to_do =
        StepsToDo(folder_->path(), planned_->plan, planned_->scene, step, final_step_, read, interrupt_, &*progress_);
    if (to_do.empty() && more == 0) return;
    std::set<int> worked_on = chosen_;
    for (const auto& [number, index] : to_do) worked_on.insert(index);
    if (!devices_) devices_.emplace(context_.make_devices(), std::vector<int>());
    devices_->ShareOut({worked_on.begin(), worked_on.end()});
    CheckDevice();
    EngineStore store(&planned_->frames, options_, folder_->path(), EngineStore::Results::kFiles, planned_->plan,
                      *devices_, steps_);
    ReconstructRun run{planned_->scene, options_, planned_->plan, *devices_, store, interrupt_, *progress_, &*folder_};
    RunTasks tasks(&run);
    tasks.AddSteps(to_do);
    progress_->Begin(options_.stage, static_cast<int>(to_do.size() + more));
    work(&run, &tasks);
    interrupt_.Check();
    ReportUnusedPriorDepth(run);
  }

  /// Has the name of the device that did the first stage.
  std::filesystem::path DeviceFile() const { return folder_->WorkFile("device", 0); }

  /// All stages must be done by devices of one model: others make other bits.
  void CheckDevice() const {
    if (!ReadWorkFile(DeviceFile())) WriteWorkFile(DeviceFile(), devices_->name());
    const std::string first = DeviceModel(ReadWorkFile(DeviceFile()).value_or(devices_->name()));
    const std::string now = DeviceModel(devices_->name());
    if (first == now) return;
    throw InvalidInputError(
        Concat("--device: the first stage was done by ", first, ", and this is ", now, ", which makes other bits"));
  }

  /// Has the checksums of an image's files once these are written.
  std::filesystem::path MapsRecord(int index) const { return folder_->WorkFile(kMapsStage, index); }

  std::string ChecksumsOfMaps(int index) const {
    std::string checksums;
    for (const std::filesystem::path& file : FilesOfImage(options_, *folder_, index)) {
      const std::optional<uint32_t> checksum = ChecksumOfFile(file);
      checksums += checksum ? Concat(*checksum, " ") : "none ";
    }
    return checksums;
  }

  void WriteMaps() {
    std::vector<const ImagePlan*> images;
    std::set<int> read;
    for (int index : targets_) {
      if (ReadWorkFile(MapsRecord(index)) == ChecksumsOfMaps(index)) continue;
      images.push_back(planned_->plan.Find(index));
      for (int other : planned_->plan.ImagesRead(*images.back())) read.insert(other);
    }
    if (images.empty()) return;
    DoWork(final_step_, read, images.size(), [&](ReconstructRun* run, RunTasks* tasks) {
      ImageFiles files(run);
      for (const ImagePlan* image : images) {
        const int written = files.AddTasks(*image, tasks);
        const int index = image->index;
        tasks->AddFileTask({written}, [this, index] { WriteWorkFile(MapsRecord(index), ChecksumsOfMaps(index)); });
      }
      tasks->Run();
      files.WarnOfDepthsTooFar();
    });
  }

  std::filesystem::path PointsFile(int index) const { return folder_->WorkFile("points", index); }
  /// Which pixels of a view are used once a chunk is fused.
  std::filesystem::path UsedFile(int chunk, int index) const {
    return folder_->WorkFile("used/" + SixDigits(chunk), index);
  }

  /// Whether all files of FuseChunk are there and whole.
  bool IsFused(int number) const {
    const Chunk& chunk = planned_->chunks.at(number);
    std::vector<std::filesystem::path> files;
    for (const ImagePlan* image : chunk.images) {
      if (image->no_map.empty()) files.push_back(PointsFile(image->index));
    }
    for (int index : chunk.reads) files.push_back(UsedFile(number, index));
    return std::all_of(files.begin(), files.end(),
                       [](const auto& file) { return CheckWorkFile(file) == WorkFileState::kWhole; });
  }

  void Fuse() {
    std::vector<int> chunks;
    std::set<int> read;
    for (const auto& [number, chunk] : planned_->chunks) {
      const auto chosen = [&](const ImagePlan* image) { return chosen_.count(image->index) > 0; };
      if (std::none_of(chunk.images.begin(), chunk.images.end(), chosen)) continue;
      const auto lacks = std::find_if_not(chunk.images.begin(), chunk.images.end(), chosen);
      if (lacks != chunk.images.end()) {
        throw InvalidInputError(Concat("--stage ", kFuseStage, ": must have whole chunks of ", options_.chunk_images,
                                       " images, and --images ", options_.images, " lacks ", (*lacks)->index));
      }
      if (IsFused(number)) continue;
      chunks.push_back(number);
      read.insert(chunk.reads.begin(), chunk.reads.end());
    }
    if (chunks.empty()) return;
    DoWork(final_step_, read, chosen_.size(), [&](ReconstructRun* run, RunTasks* tasks) {
      tasks->Run();
      for (int number : chunks) FuseChunk(run, number);
    });
  }

  /// Fuses images of a chunk as if all images of the scene were fused one after the other: which pixels earlier chunks
  /// have used comes from their files. Writes the points of each view, and last which pixels are used now. Final
  /// estimates of what it reads are in files.
  void FuseChunk(ReconstructRun* run, int number) {
    const Chunk& chunk = planned_->chunks.at(number);
    RunTasks tasks(run);
    for (const auto& [index, before] : chunk.fused_before) TakeOverFusedPixels(index, before, &tasks);
    for (const ImagePlan* image : chunk.images) {
      if (!image->no_map.empty()) continue;
      tasks.AddFusion(*image, [file = PointsFile(image->index)](const PointCloud& cloud) { WritePoints(file, cloud); });
    }
    tasks.Run();
    for (int index : chunk.reads) {
      const Image<unsigned char> used = tasks.FusedPixels(*planned_->frames.Get(index));
      interrupt_.Check();
      WriteWorkFile(UsedFile(number, index), std::string(used.begin(), used.end()));
    }
  }

  /// Throws ProcessingError if the earlier chunk is not fused.
  void TakeOverFusedPixels(int index, int chunk, RunTasks* tasks) {
    const FramePtr frame = planned_->frames.Get(index);
    Image<unsigned char> used(frame->camera.width, frame->camera.height);
    const std::string pixels = ReadWorkFile(UsedFile(chunk, index)).value_or("");
    if (pixels.size() != used.size()) {
      throw ProcessingError(Concat("--stage fuse: the stage of the images from ", chunk * options_.chunk_images,
                                   " on is not done, or ", UsedFile(chunk, index).string(), " is damaged"));
    }
    std::copy(pixels.begin(), pixels.end(), used.begin());
    tasks->SetFusedPixels(*frame, used);
  }

  void Finish() {
    const Timer timer;
    RunRecord record;
    std::string failure;
    chosen_.clear();
    DoWork(-1, {}, planned_->plan.images.size(), [&](ReconstructRun* run, RunTasks*) {
      std::vector<int> images;  // with maps
      CloudOutput cloud(*run);
      for (const ImagePlan& image : run->plan.images) {
        interrupt_.Check();
        progress_->Step();
        if (!image.no_map.empty()) continue;
        images.push_back(image.index);
        if (!options_.maps.empty() && !std::filesystem::exists(MapsRecord(image.index))) {
          FailUnfinished(kMapsStage, image.index);
        }
        const std::optional<PointCloud> points = ReadPoints(PointsFile(image.index));
        if (!points) FailUnfinished(kFuseStage, image.index);
        cloud.Add(*points);
      }
      cloud.Commit();
      WriteCameras(*run, images);
      const std::string device = ReadWorkFile(DeviceFile()).value_or("");
      record = MakeRecord(options_, device, input_);
      failure = EndRun(run, record, device, timer, cloud.size(), &context_.out);
    });
    folder_->Rewrite(record);
    folder_->RemoveWork();
    if (!failure.empty()) throw ProcessingError(failure);
  }

  [[noreturn]] void FailUnfinished(const std::string& stage, int index) const {
    throw ProcessingError(Concat("--stage ", kFinishStage, ": stage ", stage, " of image ", planned_->NameOf(index),
                                 " (index ", index, ") is not done, or its files are damaged"));
  }

  ReconstructOptions options_;
  const RunContext& context_;
  StopRequest& interrupt_;
  const std::vector<KeyframeStep> steps_;
  const int final_step_;

  std::optional<Devices> devices_;
  std::unique_ptr<PlannedScene> planned_;
  std::string input_;  ///< of the folder's run whose plan that is: another plan has another one

  // Of the stage under way.
  std::optional<OutputFolder> folder_;
  std::optional<Progress> progress_;
  std::set<int> chosen_, targets_;  ///< images that the stage is for, and of these those with a map, by scene index
};

/// "STAGE IMAGES", or "STAGE" alone.
std::pair<std::string, std::string> StageOfLine(const std::string& line) {
  std::istringstream words(line);
  std::string stage, images, more;
  words >> stage >> images >> more;
  if (!stage.empty() && more.empty()) return {stage, images};
  throw InvalidInputError(Concat("--stages: line \"", line, "\": must be STAGE IMAGES, as step_0 0-15, or finish"));
}

std::string Failure(int exit_code, std::string message) {
  std::replace(message.begin(), message.end(), '\n', ' ');
  return Concat("exit code ", exit_code, ": ", message);
}

}  // namespace

void DoStage(const ReconstructOptions& options, const RunContext& context) {
  StageRunner(options, context).Run(options.stage, options.images);
}

bool ReconstructStages(const ReconstructOptions& options, const RunContext& context, const LineReader& next) {
  Validate(options);
  std::optional<StageRunner> runner;
  bool all_done = true;
  while (const std::optional<std::string> line = next()) {
    std::string answer = "done";
    try {
      const auto [stage, images] = StageOfLine(*line);
      if (!runner) runner.emplace(options, context);
      runner->Run(stage, images);
    } catch (const InvalidInputError& error) {
      answer = Failure(kExitBadInput, error.what());
    } catch (const std::exception& error) {
      answer = Failure(kExitFailed, error.what());
    }
    if (answer != "done") runner.reset();  // an image or an engine that is not as it should be
    context.interrupt.Check();             // what a stop leaves may look like any error
    all_done = all_done && answer == "done";
    context.out << *line << ": " << answer << std::endl;
  }
  return all_done;
}

}  // namespace acmp
