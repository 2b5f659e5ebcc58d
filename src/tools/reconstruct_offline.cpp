#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "reconstruct_run.h"

namespace acmp {
namespace {

/// The steps of the offline schedule. A stage's result of an image is one file, so after an interruption the first one
/// missing is where to go on. Each engine works on another image; a geometric pass waits for the estimates it reads.
class OfflineSchedule {
 public:
  explicit OfflineSchedule(ReconstructRun* run)
      : run_(*run), pipeline_(MakePipelineOptions(run->options)), stages_(1 + pipeline_.geometric_passes) {
    for (const ImagePlan& image : run_.plan.images) {
      if (image.no_map.empty()) images_[image.index] = &image;
    }
    for (const ReconstructEngine& engine : run_.engines) estimators_.emplace_back(engine.engine, pipeline_);
  }

  size_t images() const { return images_.size(); }
  int stages() const { return stages_; }

  /// Returns the tasks of the last stage, by scene index.
  std::map<int, int> AddTasks(TaskGraph* graph) {
    const int first = FirstStageToRun();
    std::map<int, int> tasks;
    for (int stage = 0; stage < stages_; ++stage) tasks = AddStage(stage, first, tasks, graph);
    return tasks;
  }

 private:
  /// The last stage's results are kept as final maps.
  std::string StageName(int stage) const {
    if (stage == stages_ - 1) return EngineStore::kFinalStage;
    return stage == 0 ? "initial" : Concat("geometric_", stage);
  }

  std::filesystem::path FileOf(int stage, int index) const { return run_.folder.WorkFile(StageName(stage), index); }
  bool Exists(int stage, int index) const { return IsWholeWorkFile(FileOf(stage, index)); }

  /// Stages before one that is complete are not needed any more, and may have been removed.
  int FirstStageToRun() const {
    for (int stage = stages_ - 1; stage >= 0; --stage) {
      bool complete = true;
      for (const auto& [index, image] : images_) complete &= Exists(stage, index);
      if (complete) return stage + 1;
    }
    return 0;
  }

  std::map<int, int> AddStage(int stage, int first_stage, const std::map<int, int>& previous, TaskGraph* graph) {
    run_.folder.MakeWorkFolder(StageName(stage));
    std::map<int, int> tasks;
    for (const auto& [index, image] : images_) {
      const bool done = stage < first_stage || Exists(stage, index);
      tasks[index] = graph->Add(kEnginePool, TasksRead(previous, *image), [this, stage, image, done](int engine) {
        if (!done) RunOne(stage, *image, engine);
        run_.progress.Step(done);
      });
    }
    if (stage > 0) {
      std::vector<int> all;
      all.reserve(tasks.size());
      for (const auto& [index, task] : tasks) all.push_back(task);
      // No later stage reads it.
      graph->Add(kHostPool, all, [this, stage](int) {
        run_.store.DropStage(StageName(stage - 1));
        if (!run_.options.keep_work) run_.folder.RemoveWork(StageName(stage - 1));
      });
    }
    return tasks;
  }

  /// Those of the stage before whose estimates a pass over the image reads.
  static std::vector<int> TasksRead(const std::map<int, int>& previous, const ImagePlan& image) {
    std::vector<int> tasks;
    if (previous.empty()) return tasks;
    tasks.push_back(previous.at(image.index));
    for (int source : image.sources) {
      if (const auto found = previous.find(source); found != previous.end()) tasks.push_back(found->second);
    }
    return tasks;
  }

  void RunOne(int stage, const ImagePlan& image, int engine_number) {
    const ReconstructEngine& engine = run_.engines[static_cast<size_t>(engine_number)];
    DepthEstimator& estimator = estimators_[static_cast<size_t>(engine_number)];
    Timer timer;
    EngineProblem problem = run_.store.Problem(image, engine);
    const acmp::Frame& reference = *problem.reference.frame;
    EngineEstimatePtr start;
    if (stage > 0) {
      start = run_.store.Estimate(StageName(stage - 1), reference, engine);
      run_.store.AddEstimates(StageName(stage - 1), engine, &problem.sources);
    }
    const double reading_ms = timer.Lap();
    run_.interrupt.Check();
    const EngineEstimatePtr estimate =
        stage == 0 ? estimator.EstimateInitial(problem) : estimator.RefineGeometric(problem, start, stage - 1);
    run_.interrupt.Check();
    timer.Lap();
    if (stage == stages_ - 1) {
      run_.store.KeepFinal(reference, image.sources, engine, estimate);
    } else {
      run_.store.Keep(StageName(stage), reference, engine, estimate);
    }
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    run_.times.Add(estimator.last_times());
    run_.times.images += stage == 0 ? 1 : 0;
    run_.times.reading_ms += reading_ms;
    run_.times.keeping_ms += timer.Lap();
  }

  ReconstructRun& run_;
  const PipelineOptions pipeline_;
  const int stages_;
  std::map<int, const ImagePlan*> images_;  ///< that get a map, by scene index
  std::vector<DepthEstimator> estimators_;  ///< per engine
};

}  // namespace

std::map<int, int> AddOfflineSchedule(ReconstructRun* run, TaskGraph* graph) {
  const auto schedule = std::make_shared<OfflineSchedule>(run);
  std::map<int, int> tasks = schedule->AddTasks(graph);
  graph->KeepAlive(schedule);
  return tasks;
}

}  // namespace acmp
