#include <tbb/parallel_for.h>

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/pipeline/schedule.h"
#include "cloud_output.h"
#include "image_files.h"
#include "input_hash.h"
#include "run_record.h"
#include "stages.h"
#include "work_files.h"

namespace acmp {
namespace {

using nlohmann::json;

constexpr int kExitFailed = 1, kExitBadInput = 2;  // as the program's

/// A stage of some images.
class StageRun {
 public:
  /// @param folder with its plan; not finished
  /// @param planned of that plan
  /// @param devices is called if the stage needs them: not null
  StageRun(const ReconstructOptions& options, const OutputFolder& folder, PlannedScene* planned,
           const std::function<Devices*()>& devices, StopRequest* interrupt, std::ostream* out, Progress* progress)
      : options_(options),
        folder_(folder),
        planned_(*planned),
        devices_(devices),
        interrupt_(*interrupt),
        out_(*out),
        progress_(*progress),
        steps_(ScheduleOf(MakePipelineOptions(options))),
        final_step_(static_cast<int>(steps_.size()) - 1) {}

  void Run() {
    if (options_.stage == kFinishStage) return Finish();
    Choose();
    if (options_.stage == kMapsStage) return WriteMaps();
    if (options_.stage == kFuseStage) return Fuse();
    for (int step = 0; step <= final_step_; ++step) {
      if (options_.stage == EngineStore::StepName(step, final_step_)) return DoStep(step);
    }
    std::string names;
    for (const std::string& name : StagesOfChunk(options_)) names += name + ", ";
    throw InvalidInputError(Concat("--stage ", options_.stage, ": must be one of ", names, kFinishStage));
  }

 private:
  /// Takes the images of the range that take part.
  void Choose() {
    if (options_.images.empty()) throw InvalidInputError("--stage: needs --images");
    const std::vector<int> list = ParseImageIndices(options_.images, static_cast<int>(planned_.scene().images.size()));
    const std::set<int> listed(list.begin(), list.end());
    for (const auto& [number, chunk] : planned_.chunks()) {
      std::set<int> chosen;
      std::optional<int> lacks;
      for (const ImagePlan* image : chunk.images) {
        if (listed.count(image->index) > 0) {
          chosen.insert(image->index);
        } else if (!lacks) {
          lacks = image->index;
        }
      }
      if (options_.stage == kFuseStage && !chosen.empty() && lacks) {
        throw InvalidInputError(Concat("--stage ", kFuseStage, ": must have whole chunks of ", options_.chunk_images,
                                       " images, and --images ", options_.images, " lacks ", *lacks));
      }
      chosen_.merge(chosen);
    }
    if (chosen_.empty()) {
      throw InvalidInputError(Concat("--images ", options_.images, ": the plan has none of these images"));
    }
  }

  /// Those chosen that get a map.
  std::set<int> Targets() const {
    std::set<int> targets;
    for (int index : chosen_) {
      if (planned_.plan().HasMap(index)) targets.insert(index);
    }
    return targets;
  }

  std::string NameOf(int index) const { return planned_.scene().images[static_cast<size_t>(index)].name; }

  /// That the chosen images are what they were when their first stage was done; writes that down for the first one.
  void CheckContent() {
    const std::vector<int> indices(chosen_.begin(), chosen_.end());
    tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
      interrupt_.Check();
      const ImageHashes hashes = HashesOf(planned_.scene(), indices[i]);
      const std::string now = json({hashes.file, hashes.mask.value_or(0), hashes.prior_depth.value_or(0)}).dump();
      const std::filesystem::path file = folder_.WorkFile("input", indices[i]);
      const std::optional<std::string> before = ReadWorkFile(file);
      if (!before) {
        WriteWorkFile(file, now);
      } else if (*before != now) {
        throw InvalidInputError(
            Concat("image ", NameOf(indices[i]),
                   ": it, its mask or its prior depth has changed since its first stage: plan with --overwrite"));
      }
    });
    interrupt_.Check();
  }

  /// Steps that are to do before these images have estimates of a step.
  std::set<StepOfImage> ToDo(int step, const std::set<int>& targets) const {
    const auto file_of = [&](const StepOfImage& key) {
      return folder_.WorkFile(EngineStore::StepName(key.first, final_step_), key.second);
    };
    return StepsToDo(
        step, targets, file_of, [&](int index) { return ImagesRead(index); }, planned_.scene(), interrupt_, &progress_);
  }

  template <class Work>
  void OnDevices(const std::set<StepOfImage>& to_do, const Work& work) {
    std::set<int> worked_on = chosen_;
    for (const auto& [step, index] : to_do) worked_on.insert(index);
    Devices& devices = *devices_();
    devices.ShareOut({worked_on.begin(), worked_on.end()});
    CheckDevice(devices.name());
    EngineStore store(&planned_.frames(), options_, &folder_, planned_.plan(), devices, steps_);
    ReconstructRun run{planned_.scene(), options_, planned_.plan(), devices, store, interrupt_, progress_, &folder_};
    work(&run);
    interrupt_.Check();
    ReportUnusedPriorDepth(run);
  }

  /// All stages must be done by devices of one model: others make other bits.
  void CheckDevice(const std::string& name) const {
    const std::filesystem::path file = folder_.WorkFile("device", 0);
    if (!ReadWorkFile(file)) WriteWorkFile(file, name);
    const std::string first = ReadWorkFile(file).value_or(name);
    if (DeviceModel(first) != DeviceModel(name)) {
      throw InvalidInputError(Concat("--device: the first stage was done by ", DeviceModel(first), ", and this is ",
                                     DeviceModel(name), ", which makes other bits"));
    }
  }

  void DoStep(int step) {
    CheckContent();
    const std::set<StepOfImage> to_do = ToDo(step, Targets());
    std::set<int> only_checked;  // images without a map are read once, so that a damaged one is found
    for (int index : chosen_) {
      if (step == 0 && !planned_.plan().HasMap(index)) only_checked.insert(index);
    }
    if (to_do.empty() && only_checked.empty()) return;
    OnDevices(to_do, [&](ReconstructRun* run) {
      for (int index : only_checked) planned_.frames().Get(index);
      RunTasks tasks(run);
      tasks.AddSteps(to_do);
      progress_.Begin(options_.stage, static_cast<int>(to_do.size()));
      tasks.Run();
    });
  }

  std::vector<int> ImagesRead(int index) const { return planned_.plan().ImagesRead(*planned_.plan().Find(index)); }

  std::set<int> AllRead(const std::set<int>& targets) const {
    std::set<int> all;
    for (int index : targets) {
      for (int read : ImagesRead(index)) all.insert(read);
    }
    return all;
  }

  std::filesystem::path MapsRecord(int index) const { return folder_.WorkFile(kMapsStage, index); }

  /// Whether an image's files are as they were written.
  bool HasMaps(int index) const {
    const std::optional<std::string> record = ReadWorkFile(MapsRecord(index));
    if (!record) return false;
    const json files = json::parse(*record);
    for (const auto& [name, checksum] : files.items()) {
      const std::optional<uint32_t> now = ChecksumOfFile(folder_.path() / name);
      if (!now || *now != checksum.get<uint32_t>()) return false;
    }
    return true;
  }

  void RecordMaps(int index, const ImageFiles& files) const {
    json record = json::object();
    for (const std::filesystem::path& file : files.FilesOf(index)) {
      record[std::filesystem::relative(file, folder_.path()).string()] = ChecksumOfFile(file).value_or(0);
    }
    WriteWorkFile(MapsRecord(index), record.dump());
  }

  void WriteMaps() {
    std::set<int> targets;
    for (int index : Targets()) {
      if (!HasMaps(index)) targets.insert(index);
    }
    if (targets.empty()) return;
    CheckContent();
    const std::set<StepOfImage> to_do = ToDo(final_step_, AllRead(targets));
    OnDevices(to_do, [&](ReconstructRun* run) {
      RunTasks tasks(run);
      tasks.AddSteps(to_do);
      ImageFiles files(run);
      for (const ImagePlan& image : run->plan.images) {
        if (targets.count(image.index) == 0) continue;
        const int written = files.AddTasks(image, &tasks);
        tasks.AddFileTask({written}, [&, index = image.index] { RecordMaps(index, files); });
      }
      progress_.Begin(options_.stage, static_cast<int>(to_do.size() + targets.size()));
      tasks.Run();
      files.WarnOfDepthsTooFar();
    });
  }

  std::filesystem::path PointsFile(int index) const { return folder_.WorkFile("points", index); }
  /// Which pixels of a view are used once a chunk is fused.
  std::filesystem::path UsedFile(int chunk, int index) const {
    return folder_.WorkFile("used/" + SixDigits(chunk), index);
  }

  /// Whether all files of FuseChunk are there and whole.
  bool IsFused(int number) const {
    const auto is_whole = [](const std::filesystem::path& file) {
      return CheckWorkFile(file) == WorkFileState::kWhole;
    };
    const Chunk& chunk = planned_.chunks().at(number);
    return std::all_of(
               chunk.images.begin(), chunk.images.end(),
               [&](const ImagePlan* image) { return !image->no_map.empty() || is_whole(PointsFile(image->index)); }) &&
           std::all_of(chunk.reads.begin(), chunk.reads.end(),
                       [&](int index) { return is_whole(UsedFile(number, index)); });
  }

  void Fuse() {
    std::vector<int> chunks;
    std::set<int> read;
    for (const auto& [number, chunk] : planned_.chunks()) {
      if (chosen_.count(chunk.images.front()->index) == 0 || IsFused(number)) continue;
      chunks.push_back(number);
      read.insert(chunk.reads.begin(), chunk.reads.end());
    }
    if (chunks.empty()) return;
    CheckContent();
    const std::set<StepOfImage> to_do = ToDo(final_step_, read);
    OnDevices(to_do, [&](ReconstructRun* run) {
      RunTasks tasks(run);
      tasks.AddSteps(to_do);
      progress_.Begin(options_.stage, static_cast<int>(to_do.size() + chosen_.size()));
      tasks.Run();
      for (int number : chunks) FuseChunk(run, number);
    });
  }

  /// Fuses images of a chunk as if all images of the scene were fused one after the other: which pixels earlier chunks
  /// have used comes from their files. Writes the points of each view, and last which pixels are used now. Final
  /// estimates of what it reads are in files.
  void FuseChunk(ReconstructRun* run, int number) {
    const Chunk& chunk = planned_.chunks().at(number);
    RunTasks tasks(run);
    TakeOverFusedPixels(chunk.fused_before, &tasks);
    for (const ImagePlan* image : chunk.images) {
      if (!image->no_map.empty()) continue;
      tasks.AddFusion(*image,
                      [this, index = image->index](const PointCloud& cloud) { WritePoints(PointsFile(index), cloud); });
    }
    tasks.Run();
    for (int index : chunk.reads) {
      const Image<unsigned char> used = tasks.FusedPixels(*planned_.frames().Get(index));
      interrupt_.Check();
      WriteWorkFile(UsedFile(number, index), std::string(used.begin(), used.end()));
    }
  }

  /// Throws ProcessingError if one of the earlier chunks is not fused.
  /// @param fused_before see Chunk
  void TakeOverFusedPixels(const std::map<int, int>& fused_before, RunTasks* tasks) {
    for (const auto& [index, number] : fused_before) {
      const FramePtr frame = planned_.frames().Get(index);
      Image<unsigned char> used(frame->camera.width, frame->camera.height);
      const std::string pixels = ReadWorkFile(UsedFile(number, index)).value_or("");
      if (pixels.size() != used.size()) {
        throw ProcessingError(Concat("--stage fuse: the stage of the images from ", number * options_.chunk_images,
                                     " on is not done, or ", UsedFile(number, index).string(), " is damaged"));
      }
      std::copy(pixels.begin(), pixels.end(), used.begin());
      tasks->SetFusedPixels(*frame, used);
    }
  }

  void Finish() {
    const Timer timer;
    std::vector<ImageHashes> hashes;
    for (const ImagePlan& image : planned_.plan().images) {
      const std::optional<std::string> input = ReadWorkFile(folder_.WorkFile("input", image.index));
      if (!input) FailUnfinished(EngineStore::StepName(0, final_step_), image.index);
      const json content = json::parse(*input);
      hashes.push_back(
          {image.index, content.at(0).get<uint64_t>(), std::nullopt, std::nullopt, planned_.GeometryOf(image.index)});
      const SceneImage& scene_image = planned_.scene().images[static_cast<size_t>(image.index)];
      if (!scene_image.mask.empty()) hashes.back().mask = content.at(1).get<uint64_t>();
      if (!scene_image.prior_depth.empty()) hashes.back().prior_depth = content.at(2).get<uint64_t>();
    }
    const std::string device = ReadWorkFile(folder_.WorkFile("device", 0)).value_or("");
    const RunRecord record = MakeRecord(options_, device, InputHash(hashes));
    std::string failure;
    OnDevices({}, [&](ReconstructRun* run) {
      const CloudSize cloud = WriteCloudAndCameras(*run);
      failure = EndRun(run, record, device, timer, cloud, &out_);
    });
    folder_.Rewrite(record);
    folder_.RemoveWork();
    if (!failure.empty()) throw ProcessingError(failure);
  }

  CloudSize WriteCloudAndCameras(const ReconstructRun& run) {
    std::vector<int> images;
    CloudOutput cloud(run);
    progress_.Begin(options_.stage, static_cast<int>(run.plan.images.size()));
    for (const ImagePlan& image : run.plan.images) {
      interrupt_.Check();
      progress_.Step();
      if (!image.no_map.empty()) continue;
      images.push_back(image.index);
      if (!options_.maps.empty() && !std::filesystem::exists(MapsRecord(image.index))) {
        FailUnfinished(kMapsStage, image.index);
      }
      const std::optional<PointCloud> points = ReadPoints(PointsFile(image.index));
      if (!points) FailUnfinished(kFuseStage, image.index);
      cloud.WriteAt(cloud.Reserve(points->size()), *points);
    }
    cloud.Commit();
    WriteCameras(run, images);
    return cloud.size();
  }

  [[noreturn]] void FailUnfinished(const std::string& stage, int index) {
    throw ProcessingError(Concat("--stage ", kFinishStage, ": stage ", stage, " of image ", NameOf(index), " (index ",
                                 index, ") is not done, or its files are damaged"));
  }

  const ReconstructOptions& options_;
  const OutputFolder& folder_;
  PlannedScene& planned_;
  const std::function<Devices*()>& devices_;
  StopRequest& interrupt_;
  std::ostream& out_;
  Progress& progress_;
  const std::vector<KeyframeStep> steps_;
  const int final_step_;
  std::set<int> chosen_;  ///< images that the stage is for, by scene index
};

/// Does stages, one after the other. Devices, the plan and images are kept from one to the
/// next: images within their share of the memory limit, and as long as their files are not written.
class StageRunner {
 public:
  /// @param make_devices is called when a stage needs them and there are none
  StageRunner(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
              std::ostream* out, std::ostream* log, bool log_is_terminal)
      : options_(options),
        make_devices_(make_devices),
        interrupt_(*interrupt),
        out_(*out),
        log_(*log),
        log_is_terminal_(log_is_terminal) {
    options_.keep_work = true;  // everything in files: no process can count on the memory of another
  }

  /// After a failure nothing is kept.
  void Run(const std::string& stage, const std::string& images) {
    options_.stage = stage;
    options_.images = images;
    try {
      RunStage();
    } catch (...) {
      planned_.reset();  // an image or an engine that is not as it should be
      devices_.reset();
      throw;
    }
  }

  /// "STAGE IMAGES", or "STAGE" alone.
  void RunLine(const std::string& line) {
    std::istringstream words(line);
    std::string stage, images, more;
    words >> stage >> images >> more;
    if (stage.empty() || !more.empty()) {
      throw InvalidInputError(Concat("--stages: line \"", line, "\": must be STAGE IMAGES, as step_0 0-15, or finish"));
    }
    Run(stage, images);
  }

 private:
  void RunStage() {
    const std::string name = options_.output.string();
    if (!OutputFolder::Exists(options_.output)) throw InvalidInputError(name + ": has no plan: give --plan first");
    const OutputFolder folder(options_.output, SettingsRecord(options_), false, OutputFolder::Use::kStages);
    const std::string chunk_images = folder.Setting(kChunkImagesKey);
    const bool is_staged = chunk_images == Concat(options_.chunk_images);
    if (folder.state() == OutputFolder::State::kComplete && !(is_staged && options_.stage == kFinishStage)) {
      return ReportComplete(folder, name + ": already complete", options_.quiet, &out_);
    }
    if (!is_staged) {
      throw InvalidInputError(
          Concat("--chunk-images ", options_.chunk_images, ": the plan in ", name, " has ", chunk_images));
    }
    const std::string input = folder.Setting(kInputKey);
    if (!planned_ || input_ != input) planned_ = std::make_unique<PlannedScene>(options_);
    input_ = input;
    Progress progress(&log_, ProgressStyleFor(options_.quiet, log_is_terminal_));
    const auto devices = [&] {
      if (!devices_) devices_.emplace(make_devices_(), std::vector<int>());
      return &*devices_;
    };
    StageRun(options_, folder, planned_.get(), devices, &interrupt_, &out_, &progress).Run();
  }

  ReconstructOptions options_;
  const DeviceMaker& make_devices_;
  StopRequest& interrupt_;
  std::ostream& out_;
  std::ostream& log_;
  const bool log_is_terminal_;
  std::optional<Devices> devices_;
  std::unique_ptr<PlannedScene> planned_;
  std::string input_;  ///< of the folder's run whose plan that is: another plan has another one
};

std::string Failure(int exit_code, std::string message) {
  std::replace(message.begin(), message.end(), '\n', ' ');
  return Concat("exit code ", exit_code, ": ", message);
}

}  // namespace

void DoStage(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
             std::ostream* out, std::ostream* log, bool log_is_terminal) {
  StageRunner(options, make_devices, interrupt, out, log, log_is_terminal).Run(options.stage, options.images);
}

bool ReconstructStages(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
                       const LineReader& next, std::ostream* out, std::ostream* log, bool log_is_terminal) {
  Validate(options);
  StageRunner runner(options, make_devices, interrupt, out, log, log_is_terminal);
  bool all_done = true;
  while (const std::optional<std::string> line = next()) {
    std::string answer = "done";
    try {
      runner.RunLine(*line);
    } catch (const InvalidInputError& error) {
      answer = Failure(kExitBadInput, error.what());
    } catch (const std::exception& error) {
      answer = Failure(kExitFailed, error.what());
    }
    interrupt->Check();  // what a stop leaves may look like any error
    all_done = all_done && answer == "done";
    *out << *line << ": " << answer << std::endl;
  }
  return all_done;
}

}  // namespace acmp
