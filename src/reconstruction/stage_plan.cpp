#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/pipeline/schedule.h"
#include "chunk_plans.h"
#include "engine_store.h"
#include "input_hash.h"
#include "run_record.h"
#include "stages.h"
#include "summary.h"

namespace acmp {
namespace {

/// A stage of a chunk, by the stage's place among StagesOfChunk; in the order in which one process would do what is
/// ready: late stages first, so that chunks are finished early.
struct Task {
  int stage = 0;
  int chunk = 0;
  bool operator<(const Task& other) const { return stage != other.stage ? stage > other.stage : chunk < other.chunk; }
};

class TaskList {
 public:
  TaskList(const ReconstructPlan& plan, const ReconstructOptions& options)
      : plan_(plan), chunk_images_(options.chunk_images), stages_(StagesOfChunk(options)) {
    for (const ImagePlan& image : plan.images) {
      Chunk& chunk = chunks_[image.index / chunk_images_];
      if (chunk.first < 0) chunk.first = image.index;
      chunk.last = image.index;
    }
    FindWhatIsRead();
    for (const auto& [number, chunk] : chunks_) {
      for (size_t stage = 0; stage < stages_.size(); ++stage) AddTask({static_cast<int>(stage), number});
    }
  }

  nlohmann::ordered_json ToJson() {
    nlohmann::ordered_json list = nlohmann::json::array();
    std::map<Task, int> numbers;
    std::set<Task> ready;
    for (const auto& [task, after] : after_) {
      if (after.empty()) ready.insert(task);
    }
    while (!ready.empty()) {
      const Task task = *ready.begin();
      ready.erase(ready.begin());
      std::vector<int> after;
      for (const Task& other : after_.at(task)) after.push_back(numbers.at(other));
      numbers[task] = static_cast<int>(list.size());
      const Chunk& chunk = chunks_.at(task.chunk);
      list.push_back({{"stage", stages_[static_cast<size_t>(task.stage)]},
                      {"images", Concat(chunk.first, "-", chunk.last)},
                      {"after", after}});
      for (const Task& follower : followers_[task]) {
        if (++done_[follower] == after_.at(follower).size()) ready.insert(follower);
      }
    }
    AddFinish(&list);
    return list;
  }

 private:
  struct Chunk {
    int first = -1, last = -1;   ///< scene indices
    std::set<int> reads;         ///< chunks whose estimates its images' refinements read, itself among them
    std::set<int> fused_before;  ///< earlier ones whose points use pixels of its views
  };

  void FindWhatIsRead() {
    std::map<int, int> last_chunk;  // whose points use pixels of a view, by scene index
    for (const ImagePlan& image : plan_.images) {
      if (!image.no_map.empty()) continue;
      const int number = image.index / chunk_images_;
      Chunk& chunk = chunks_.at(number);
      for (int read : plan_.ImagesRead(image)) {
        chunk.reads.insert(read / chunk_images_);
        const auto [last, is_first] = last_chunk.emplace(read, number);
        if (!is_first && last->second != number) chunk.fused_before.insert(std::exchange(last->second, number));
      }
    }
  }

  void AddTask(const Task& task) {
    const int steps = static_cast<int>(std::find(stages_.begin(), stages_.end(), "final") - stages_.begin()) + 1;
    std::vector<Task> after;
    const Chunk& chunk = chunks_.at(task.chunk);
    if (task.stage > 0) {
      for (int read : chunk.reads) after.push_back({std::min(task.stage, steps) - 1, read});
    }
    if (stages_[static_cast<size_t>(task.stage)] == kFuseStage) {
      for (int before : chunk.fused_before) after.push_back({task.stage, before});
    }
    for (const Task& other : after) followers_[other].push_back(task);
    after_[task] = std::move(after);
  }

  void AddFinish(nlohmann::ordered_json* list) const {
    std::vector<int> after;
    for (size_t i = 0; i < list->size(); ++i) {
      const auto& stage = (*list)[i]["stage"];
      if (stage == kMapsStage || stage == kFuseStage) after.push_back(static_cast<int>(i));
    }
    list->push_back({{"stage", kFinishStage}, {"images", ""}, {"after", after}});
  }

  const ReconstructPlan& plan_;
  const int chunk_images_;
  const std::vector<std::string> stages_;
  std::map<int, Chunk> chunks_;
  std::map<Task, std::vector<Task>> after_, followers_;
  std::map<Task, size_t> done_;  ///< of what a task waits for
};

std::string HashOf(const std::map<int, std::string>& files) {
  Hash hash;
  for (const auto& [number, content] : files) {
    hash.Add(number);
    hash.Add(content);
  }
  return HexDigits(hash.value());
}

/// Of all input, as a whole run has it: reads the files.
std::string HashOfInput(const Scene& scene, const ReconstructPlan& plan) {
  std::vector<ImageHashes> hashes;
  for (const ImagePlan& image : plan.images) hashes.push_back(HashesOf(scene, image.index));
  return InputHash(hashes);
}

/// Whether a finished run with these settings and this input is there.
bool IsComplete(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options) {
  if (options.overwrite || !OutputFolder::Exists(options.output)) return false;
  const OutputFolder folder(options.output, {}, false, OutputFolder::Use::kStages);
  if (folder.state() != OutputFolder::State::kComplete || folder.Setting(kChunkImagesKey) != "(none)") return false;
  for (const auto& [key, value] : SettingsRecord(options)) {
    if (folder.Setting(key) != value) return false;
  }
  return folder.Setting(kInputKey) == HashOfInput(scene, plan);
}

}  // namespace

std::vector<std::string> StagesOfChunk(const ReconstructOptions& options) {
  const int final_step = static_cast<int>(ScheduleOf(MakePipelineOptions(options)).size()) - 1;
  std::vector<std::string> stages;
  for (int step = 0; step <= final_step; ++step) stages.push_back(EngineStore::StepName(step, final_step));
  if (!options.maps.empty()) stages.emplace_back(kMapsStage);
  stages.emplace_back(kFuseStage);
  return stages;
}

void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options, Progress* progress,
                std::ostream* out) {
  for (const ImagePlan& image : plan.images) {
    if (!image.no_map.empty()) {
      progress->Warn(
          Concat("no map for image ", scene.images[static_cast<size_t>(image.index)].name, ": ", image.no_map));
    }
  }
  const bool complete = IsComplete(scene, plan, options);
  nlohmann::ordered_json tasks = nlohmann::json::array();
  if (!complete) {
    const std::map<int, std::string> files = ChunkPlans::Format(scene, options.scene, plan, options.chunk_images);
    RunRecord record = MakeRecord(options, "that of the first stage", Concat("that of plan ", HashOf(files)));
    record.emplace_back(kChunkImagesKey, Concat(options.chunk_images));
    const OutputFolder folder(options.output, record, options.overwrite, OutputFolder::Use::kStages);
    ChunkPlans(options.output, options.scene, options.chunk_images).Write(files);
    tasks = TaskList(plan, options).ToJson();
  }
  const size_t count = tasks.size();
  nlohmann::ordered_json json = {{"complete", complete}, {"tasks", std::move(tasks)}};
  WriteFileAtomically(options.plan, json.dump() + "\n");
  const std::string failure =
      complete ? FailureOfSummary(OutputFolder(options.output, {}, false, OutputFolder::Use::kStages).SummaryFile())
               : std::string();
  if (!failure.empty()) throw ProcessingError(failure);
  if (options.quiet) return;
  *out << options.plan.string() << ": ";
  if (complete) {
    *out << options.output.string() << " is already complete" << std::endl;
  } else {
    *out << count << " tasks for " << plan.images.size() << " images in chunks of " << options.chunk_images
         << std::endl;
  }
}

}  // namespace acmp
