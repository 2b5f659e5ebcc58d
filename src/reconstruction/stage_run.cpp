#include <algorithm>
#include <memory>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
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
      : options_(options), context_(context), interrupt_(context.interrupt) {}

  /// After a failure it is not to be used again.
  void Run(const std::string& stage, const std::string& images) {
    const Timer timer;
    options_.stage = stage;
    options_.images = images;
    const std::string name = options_.output.string();
    if (!OutputFolder::Exists(options_.output)) throw InvalidInputError(name + ": has no plan: give --plan first");
    const OutputFolder folder(options_.output, SettingsRecord(options_), false, OutputFolder::Use::kStages);
    if (folder.state() == OutputFolder::State::kComplete) {
      return ReportComplete(folder, "", options_, &context_.out);
    }
    const std::string input = folder.Setting(kInputKey);
    if (!planned_ || input_ != input) planned_ = std::make_unique<PlannedScene>(options_);
    input_ = input;
    const std::vector<std::string> stages = StagesOfChunk(options_);
    const auto place = static_cast<size_t>(std::find(stages.begin(), stages.end(), stage) - stages.begin());
    if (stage != kFinishStage && place == stages.size()) {
      std::string names;
      for (const std::string& known : stages) names += known + ", ";
      throw InvalidInputError(Concat("--stage ", stage, ": must be one of ", names, kFinishStage));
    }
    const std::set<int> chosen = stage == kFinishStage ? AllImages() : ChosenImages();
    CheckContent(chosen);
    if (!devices_) devices_.emplace(context_.make_devices());
    const std::string device = CheckDevice(folder.WorkFile("device", 0));
    Progress progress(&context_.log, ProgressStyleFor(options_.quiet, context_.log_is_terminal));
    // Everything in files: no process can count on the memory of another.
    EngineStore store(&planned_->frames, options_, folder.path(), EngineStore::Place::kKeptFiles, planned_->plan,
                      *devices_);
    ReconstructRun run{planned_->scene, options_, planned_->plan, *devices_, store, interrupt_, progress, &folder};
    if (stage == kFinishStage) {
      const CloudSize cloud = RunAndWriteResults(&run);
      ReportUnusedPriorDepth(run);
      const RunRecord record = MakeRecord(options_, device, input);
      folder.Rewrite(record);
      return EndRun(&run, record, device, timer, cloud, &context_.out);
    }
    std::set<int> targets;
    for (int index : chosen) {
      if (planned_->plan.HasMap(index)) targets.insert(index);
    }
    RunStage(&run, std::min(static_cast<int>(place), store.final_step()), targets, stage == kMapsStage);
    interrupt_.Check();
    ReportUnusedPriorDepth(run);
  }

 private:
  std::set<int> AllImages() const {
    const std::vector<int> indices = planned_->plan.Indices();
    return {indices.begin(), indices.end()};
  }

  /// Images of options.images that take part.
  std::set<int> ChosenImages() const {
    if (options_.images.empty()) throw InvalidInputError("--stage: needs --images");
    std::set<int> chosen;
    for (int index : ParseImageIndices(options_.images, static_cast<int>(planned_->scene.images.size()))) {
      if (planned_->plan.Find(index)) chosen.insert(index);
    }
    if (!chosen.empty()) return chosen;
    throw InvalidInputError(Concat("--images ", options_.images, ": the plan has none of these images"));
  }

  /// Throws InvalidInputError unless the images are what they were when they were planned.
  void CheckContent(const std::set<int>& images) const {
    const std::vector<int> indices(images.begin(), images.end());
    const std::vector<uint64_t> now = HashFiles(planned_->scene, indices, interrupt_, [](int) {});
    for (size_t i = 0; i < indices.size(); ++i) {
      if (now[i] == planned_->files.at(indices[i])) continue;
      throw InvalidInputError(
          Concat("image ", planned_->scene.images[static_cast<size_t>(indices[i])].name,
                 ": it, its mask or its prior depth has changed since it was planned: plan with --overwrite"));
    }
  }

  /// All stages must be done by devices of one model: others make other bits.
  /// @param file has the name of the device that did the first stage
  /// @return that name
  std::string CheckDevice(const std::filesystem::path& file) const {
    if (!ReadWorkFile(file)) WriteWorkFile(file, devices_->name());
    std::string first = ReadWorkFile(file).value_or(devices_->name());
    if (DeviceModel(first) == DeviceModel(devices_->name())) return first;
    throw InvalidInputError(Concat("--device: the first stage was done by ", DeviceModel(first), ", and this is ",
                                   DeviceModel(devices_->name()), ", which makes other bits"));
  }

  ReconstructOptions options_;
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
