#include <algorithm>
#include <sstream>

#include "acmp_mapping/common/error.h"
#include "run_record.h"
#include "stage_run.h"
#include "stages.h"
#include "summary.h"

namespace acmp {
namespace {

constexpr int kExitFailed = 1, kExitBadInput = 2;  // as the program's

/// "STAGE IMAGES", or "STAGE" alone.
void RunLine(const std::string& line, StageRunner* runner) {
  std::istringstream words(line);
  std::string stage, images, more;
  words >> stage >> images >> more;
  if (stage.empty() || !more.empty()) {
    throw InvalidInputError(Concat("--stages: line \"", line, "\": must be STAGE IMAGES, as step_0 0-15, or finish"));
  }
  runner->Run(stage, images);
}

std::string Failure(int exit_code, std::string message) {
  std::replace(message.begin(), message.end(), '\n', ' ');
  return Concat("exit code ", exit_code, ": ", message);
}

}  // namespace

/// From one stage to the next.
struct StageRunner::Kept {
  std::optional<Devices> devices;
  std::unique_ptr<PlannedScene> planned;
};

StageRunner::StageRunner(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
                         std::ostream* out, std::ostream* log, bool log_is_terminal)
    : options_(options),
      make_devices_(make_devices),
      interrupt_(*interrupt),
      out_(*out),
      log_(*log),
      log_is_terminal_(log_is_terminal),
      kept_(std::make_unique<Kept>()) {
  options_.keep_work = true;  // everything in files: no process can count on the memory of another
}

StageRunner::~StageRunner() = default;

void StageRunner::Run(const std::string& stage, const std::string& images) {
  options_.stage = stage;
  options_.images = images;
  try {
    RunStage();
  } catch (...) {
    kept_ = std::make_unique<Kept>();  // an engine or an image that is not as it should be
    throw;
  }
}

void StageRunner::RunStage() {
  if (!OutputFolder::Exists(options_.output)) {
    throw InvalidInputError(Concat(options_.output.string(), ": has no plan: give --plan first"));
  }
  const OutputFolder folder(options_.output, SettingsRecord(options_), false, OutputFolder::Use::kStages);
  const std::string chunk_images = folder.Setting(kChunkImagesKey);
  const bool is_staged = chunk_images == Concat(options_.chunk_images);
  if (folder.state() == OutputFolder::State::kComplete && !(is_staged && options_.stage == kFinishStage)) {
    if (!options_.quiet) out_ << options_.output.string() << ": already complete" << std::endl;
    const std::string failure = FailureOfSummary(folder.SummaryFile());
    if (!failure.empty()) throw ProcessingError(failure);
    return;
  }
  if (!is_staged) {
    throw InvalidInputError(Concat("--chunk-images ", options_.chunk_images, ": the plan in ", options_.output.string(),
                                   " has ", chunk_images));
  }
  const std::string input = folder.Setting(kInputKey);
  if (!kept_->planned || kept_->planned->input != input) {
    kept_->planned = std::make_unique<PlannedScene>(options_, input);
  }
  Progress progress(&log_, ProgressStyleFor(options_.quiet, log_is_terminal_));
  const auto devices = [&] {
    if (!kept_->devices) kept_->devices.emplace(make_devices_(), std::vector<int>());
    return &*kept_->devices;
  };
  DoStage(options_, folder, kept_->planned.get(), devices, &interrupt_, &out_, &progress);
}

bool ReconstructStages(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
                       const LineReader& next, std::ostream* out, std::ostream* log, bool log_is_terminal) {
  Validate(options);
  StageRunner runner(options, make_devices, interrupt, out, log, log_is_terminal);
  bool all_done = true;
  while (const std::optional<std::string> line = next()) {
    std::string answer = "done";
    try {
      RunLine(*line, &runner);
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
