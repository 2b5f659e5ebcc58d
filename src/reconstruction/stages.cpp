// A run whose parts are done by many processes: PlanStages once, then each stage of each chunk, the last one being
// kFinishStage. A chunk is images of successive scene indices: chunk k has those of [k n, (k + 1) n) that take part.
// All files are whole or absent and depend on the input alone, so that any of it may be done again, at the same time or
// after a crash.

#include <sys/file.h>

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/pipeline/presets.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "plan.h"
#include "run.h"
#include "work_files.h"

namespace acmp {
namespace {

constexpr const char* kMapsStage = "maps";         // confidence, map files and pictures
constexpr const char* kFinishStage = "finish";     // all that is missing of the run: with the stages before, the cloud
constexpr int kExitFailed = 1, kExitBadInput = 2;  // as the program's

using Json = nlohmann::ordered_json;

std::filesystem::path PlanFile(const std::filesystem::path& output) {
  return OutputFolder::WorkFile(output, "plan", 0);
}

/// The stages of each chunk in their order: the steps of the schedule, and maps.
std::vector<std::string> StagesOfChunk(const ReconstructOptions& options) {
  const int final_step = static_cast<int>(ScheduleOf(MakePipelineOptions(options)).size()) - 1;
  std::vector<std::string> stages;
  for (int step = 0; step <= final_step; ++step) stages.push_back(EngineStore::StepName(step, final_step));
  if (!options.maps.empty()) stages.emplace_back(kMapsStage);
  return stages;
}

/// The tasks, stage by stage.
Json ListOfTasks(const ReconstructPlan& plan, const ReconstructOptions& options) {
  struct Chunk {
    int first = 0, last = 0;  // scene indices
    std::set<int> reads;      // chunks whose estimates its own ones are made of
  };
  std::map<int, Chunk> chunks;
  for (const ImagePlan& image : plan.images) {
    Chunk& chunk = chunks.try_emplace(image.index / options.chunk_images, Chunk{image.index, 0, {}}).first->second;
    chunk.last = image.index;
    if (!image.no_map.empty()) continue;
    for (int read : plan.ImagesRead(image)) chunk.reads.insert(read / options.chunk_images);
  }
  Json list = Json::array(), last = Json::array();
  std::map<int, int> before, now;  // numbers of the tasks of a stage, by chunk
  for (const std::string& stage : StagesOfChunk(options)) {
    last = Json::array();
    for (const auto& [number, chunk] : chunks) {
      Json after = Json::array();
      for (int read : before.empty() ? std::set<int>() : chunk.reads) after.push_back(before.at(read));
      now[number] = static_cast<int>(list.size());
      last.push_back(list.size());
      list.push_back({{"stage", stage}, {"images", Concat(chunk.first, "-", chunk.last)}, {"after", after}});
    }
    before = now;
  }
  list.push_back({{"stage", kFinishStage}, {"images", ""}, {"after", last}});
  return list;
}

/// The plan in an output folder, and its images, which keep their indices. Stays where it is made.
struct PlannedScene {
  /// Reads it. Throws InvalidInputError where there is none.
  /// @param options name the folder, and the scene, which may lie elsewhere than it did
  explicit PlannedScene(const ReconstructOptions& options);

  Scene scene;  ///< without landmarks and ranking, which only the plan is made of
  ReconstructPlan plan;
  std::map<int, std::string> files;  ///< HashFiles when it was planned, by scene index
  FrameStore frames;
};

PlannedScene::PlannedScene(const ReconstructOptions& options)
    : frames(scene, options.max_image_size, options.MemoryBytes(options.kImageShare)) {
  const std::optional<std::string> content = ReadWorkFile(PlanFile(options.output));
  if (!content) throw InvalidInputError(Concat(options.output.string(), ": has no plan: give --plan first"));
  try {
    ParsePlan(*content, options.scene, &scene, &plan, &files);
  } catch (const Json::exception& error) {
    throw InvalidInputError(Concat(options.output.string(), ": its plan is of another version (", error.what(),
                                   "): give --plan --overwrite first"));
  }
}

/// Does stages, one after the other. Devices, the plan and images are kept from one to the next: images within their
/// share of the memory limit.
class StageRunner {
 public:
  /// Devices are made when a stage needs them.
  StageRunner(const ReconstructOptions& options, const RunContext& context)
      : options_(options), context_(context), interrupt_(context.interrupt) {}

  /// After a failure it is not to be used again.
  void Run(const std::string& stage, const std::string& images) {
    const Timer timer;
    const std::string name = options_.output.string();
    Progress progress(&context_.log, &context_.out, options_.quiet, context_.log_is_terminal);
    if (!OutputFolder::Exists(options_.output)) throw InvalidInputError(name + ": has no plan: give --plan first");
    const OutputFolder folder(options_.output, SettingsRecord(options_), false, OutputFolder::Use::kStages);
    if (folder.state() == OutputFolder::State::kComplete) {
      return ReportComplete(folder, "", options_, &progress);
    }
    const std::string input = folder.Setting(kInputKey);
    if (!planned_ || input_ != input) planned_ = std::make_unique<PlannedScene>(options_);
    input_ = input;
    const std::vector<std::string> stages = StagesOfChunk(options_);
    const auto place = static_cast<size_t>(std::find(stages.begin(), stages.end(), stage) - stages.begin());
    if (stage != kFinishStage && place == stages.size()) {
      std::string names;
      for (const std::string& known : stages) names += known + ", ";
      throw InvalidInputError(Concat("stage ", stage, ": must be one of ", names, kFinishStage));
    }
    const std::vector<int> chosen = stage == kFinishStage ? planned_->plan.Indices() : ChosenImages(images);
    CheckContent(chosen);
    if (!devices_) devices_.emplace(context_.make_devices());
    const std::string device = CheckDevice(folder.WorkFile("device", 0));
    ReconstructRun run{planned_->scene,  options_,   planned_->plan, *devices_,
                       planned_->frames, interrupt_, progress,       &folder};
    if (stage == kFinishStage) {
      const size_t points = RunAndWriteResults(&run);
      const RunRecord record = MakeRecord(options_, device, input);
      folder.Rewrite(record);
      return EndRun(&run, record, device, timer, points);
    }
    std::set<int> targets;
    for (int index : chosen) {
      if (planned_->plan.HasMap(index)) targets.insert(index);
    }
    RunStage(&run, stage, std::min(static_cast<int>(place), run.store.final_step()), targets, stage == kMapsStage);
    interrupt_.Check();
    progress.Warn(DescribeUnusedPriorDepth(run));
  }

 private:
  /// Images of the list that take part.
  std::vector<int> ChosenImages(const std::string& images) const {
    if (images.empty()) throw InvalidInputError("stage without images: must be STAGE IMAGES, as step_0 0-15");
    std::vector<int> chosen;
    for (int index : ParseImageIndices(images, static_cast<int>(planned_->scene.images.size()))) {
      if (planned_->plan.Find(index)) chosen.push_back(index);
    }
    if (!chosen.empty()) return chosen;
    throw InvalidInputError(Concat("images ", images, ": the plan has none of these images"));
  }

  /// Throws InvalidInputError unless the images are what they were when they were planned.
  void CheckContent(const std::vector<int>& indices) const {
    std::vector<std::string> planned;
    for (int index : indices) planned.push_back(planned_->files.at(index));
    const int changed = FindChangedImage(planned_->scene, indices, planned, interrupt_);
    if (changed < 0) return;
    throw InvalidInputError(Concat("image ", planned_->scene.images[static_cast<size_t>(changed)].name,
                                   ": it, its mask or its prior depth has changed since it was planned: plan with "
                                   "--overwrite"));
  }

  /// All stages must be done by devices of one model: others make other bits.
  /// @param file has the name of the device that did the first stage
  /// @return that name
  std::string CheckDevice(const std::filesystem::path& file) const {
    {
      const FileLock lock(file.string() + ".lock", LOCK_EX);  // of those that begin at once one is the first
      if (!ReadWorkFile(file)) WriteWorkFile(file, devices_->name());
    }
    std::string first = ReadWorkFile(file).value_or(devices_->name());
    if (DeviceModel(first) == DeviceModel(devices_->name())) return first;
    throw InvalidInputError(Concat("--device: the first stage was done by ", DeviceModel(first), ", and this is ",
                                   DeviceModel(devices_->name()), ", which makes other bits"));
  }

  const ReconstructOptions options_;
  const RunContext& context_;
  StopRequest& interrupt_;
  std::optional<Devices> devices_;
  std::unique_ptr<PlannedScene> planned_;
  std::string input_;  ///< of the folder's run whose plan that is: another plan has another one
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

void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options,
                const StopRequest& interrupt, FrameStore* frames, Progress* progress) {
  ReportImagesWithoutMap(plan, scene, progress);
  const std::vector<std::string> files = HashFiles(scene, plan.Indices(), interrupt, [&](int index) {
    if (!plan.HasMap(index)) frames->Get(index);
  });
  const RunRecord record = MakeRecord(options, "", InputHash(scene, plan.Indices(), files));
  const OutputFolder folder(options.output, record, options.overwrite, OutputFolder::Use::kStages);
  const bool complete = folder.state() == OutputFolder::State::kComplete;
  if (!complete && folder.Setting(kDeviceKey) != "(none)" && !std::filesystem::exists(PlanFile(options.output))) {
    throw InvalidInputError(Concat(options.output.string(),
                                   ": holds an interrupted run of one process: the same command ",
                                   "without --plan goes on, --overwrite starts afresh"));
  }
  const Json tasks = complete ? Json::array() : ListOfTasks(plan, options);
  WriteFileAtomically(options.plan, Json({{"complete", complete}, {"tasks", tasks}}).dump() + "\n");
  if (complete) return ReportComplete(folder, options.plan.string() + ": ", options, progress);
  const std::string content = FormatPlan(scene, plan, files, options.scene);
  if (ReadWorkFile(PlanFile(options.output)) != content) WriteWorkFile(PlanFile(options.output), content);
  progress->Result(Concat(options.plan.string(), ": ", tasks.size(), " tasks for ", plan.images.size(),
                          " images in chunks of ", options.chunk_images));
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
