#include <algorithm>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "reconstruct_run.h"

namespace acmp {
namespace {

/// The steps of the offline schedule. A stage's result of an image is one file, or on a GPU only in its memory
/// (EngineStore::Keep): after an interruption what has no file and is still read is made again. Each engine works on
/// another image; a geometric pass waits for the estimates it reads.
class OfflineSchedule {
 public:
  explicit OfflineSchedule(ReconstructRun* run) : run_(*run) {
    const PipelineOptions pipeline = MakePipelineOptions(run->options);
    for (const ImagePlan& image : run_.plan.images) {
      if (image.no_map.empty()) images_[image.index] = &image;
    }
    for (const ReconstructEngine& engine : run_.engines) estimators_.emplace_back(engine.engine, pipeline);
    stages_ = 1 + NumRefinements(pipeline);
  }

  /// Returns the tasks of the last stage, by scene index.
  /// An image's passes are numbered as early as what they read allows, so that the first images are finished, written
  /// and forgotten while the last ones are still to come. On several devices neighbours in the order of the scene,
  /// which mostly see the same, are on the same one.
  std::map<int, int> AddTasks(TaskGraph* graph) {
    FindStepsToDo();
    for (int stage = 0; stage < stages_; ++stage) {
      run_.folder.MakeWorkFolder(StageName(stage));
      for (const auto& [index, image] : images_) {
        for (int other : EstimatesRead(*image)) readers_[{stage, other}].push_back(index);
      }
    }
    for (const auto& [index, image] : images_) AddWithReaders(0, index, graph);
    for (int stage = 1; stage < stages_; ++stage) AddCleaning(stage, graph);
    std::map<int, int> last;
    for (const auto& [index, image] : images_) last[index] = tasks_.at({stages_ - 1, index});
    return last;
  }

 private:
  /// The last stage's results are kept as final maps.
  std::string StageName(int stage) const {
    if (stage == stages_ - 1) return EngineStore::kFinalStage;
    return stage == 0 ? "initial" : Concat("refined_", stage);
  }

  std::filesystem::path FileOf(int stage, int index) const { return run_.folder.WorkFile(StageName(stage), index); }
  bool Exists(int stage, int index) const { return IsWholeWorkFile(FileOf(stage, index)); }

  using Step = std::pair<int, int>;  ///< stage, scene index

  /// Images whose estimates of the stage before a pass over the image reads.
  std::vector<int> EstimatesRead(const ImagePlan& image) const {
    std::vector<int> indices = {image.index};
    for (int source : image.sources) {
      if (images_.count(source) > 0) indices.push_back(source);
    }
    return indices;
  }

  /// Those without a file whose results are final or read by others that are to do.
  void FindStepsToDo() {
    std::set<Step> read;
    for (int stage = stages_ - 1; stage >= 0; --stage) {
      for (const auto& [index, image] : images_) {
        const bool wanted = stage == stages_ - 1 || read.count({stage, index}) > 0;
        if (!wanted || Exists(stage, index)) continue;
        to_do_.insert({stage, index});
        for (int other : EstimatesRead(*image)) read.insert({stage - 1, other});
      }
    }
  }

  /// Adds a step, and then those that waited for it last.
  void AddWithReaders(int stage, int index, TaskGraph* graph) {
    const ImagePlan& image = *images_.at(index);
    std::vector<int> after;
    if (stage > 0) {
      for (int read : EstimatesRead(image)) after.push_back(tasks_.at({stage - 1, read}));
    }
    const bool done = to_do_.count({stage, index}) == 0;
    const int pool = EnginePoolOf(run_, index);
    tasks_[{stage, index}] = graph->Add(pool, after, [this, stage, &image, done, pool](int thread) {
      if (!done) RunOne(stage, image, EngineOf(run_, pool, thread));
      if (stage > 0) ForgetWhatAllHaveRead(stage, image);
      run_.progress.Step(done);
    });
    if (stage + 1 == stages_) return;
    for (int reader : readers_.at({stage, index})) {
      const size_t ready = ++ready_[{stage + 1, reader}];
      if (ready == EstimatesRead(*images_.at(reader)).size()) AddWithReaders(stage + 1, reader, graph);
    }
  }

  /// A pass has read the estimates of the stage before. Memory for those of which it was the last reader is free then.
  void ForgetWhatAllHaveRead(int stage, const ImagePlan& image) {
    for (int read : EstimatesRead(image)) {
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (++has_read_[{stage, read}] < readers_.at({stage - 1, read}).size()) continue;
      }
      run_.store.Forget(StageName(stage - 1), read);
    }
  }

  /// After a stage no later one reads the files of that before it. What was kept in memory only has to be made of them
  /// again after an interruption, though.
  void AddCleaning(int stage, TaskGraph* graph) {
    std::vector<int> all;
    for (const auto& [index, image] : images_) all.push_back(tasks_.at({stage, index}));
    graph->Add(kHostPool, all, [this, stage](int) {
      const bool all_in_files =
          std::all_of(images_.begin(), images_.end(), [&](const auto& image) { return Exists(stage, image.first); });
      if (all_in_files && !run_.options.keep_work) run_.folder.RemoveWork(StageName(stage - 1));
    });
  }

  void RunOne(int stage, const ImagePlan& image, int engine_number) {
    const ReconstructEngine& engine = run_.engines[static_cast<size_t>(engine_number)];
    DepthEstimator& estimator = estimators_[static_cast<size_t>(engine_number)];
    Timer timer;
    EngineProblem problem = run_.store.Problem(image, engine);
    const acmp::Frame& reference = *problem.reference.frame;
    if (stage > 0) {
      problem.reference.estimate = run_.store.Estimate(StageName(stage - 1), reference, engine);
      run_.store.AddEstimates(StageName(stage - 1), engine, &problem.sources);
    }
    const double reading_ms = timer.Lap();
    run_.interrupt.Check();
    const EngineEstimatePtr estimate =
        stage == 0 ? estimator.EstimateInitial(problem) : estimator.Refine(problem, stage - 1);
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
  int stages_ = 1;
  std::map<int, const ImagePlan*> images_;  ///< that get a map, by scene index
  std::vector<DepthEstimator> estimators_;  ///< per engine
  std::set<Step> to_do_;                    ///< the others have files, or nothing reads their results any more
  std::map<Step, int> tasks_;
  std::map<Step, std::vector<int>> readers_;  ///< images whose pass of the next stage reads the step's estimate
  std::map<Step, size_t> ready_;              ///< how many of what a step reads have been added
  std::mutex mutex_;                          ///< of what follows
  std::map<Step, size_t> has_read_;           ///< by stage of the readers and image: how many have
};

}  // namespace

std::map<int, int> AddOfflineSchedule(ReconstructRun* run, TaskGraph* graph) {
  const auto schedule = std::make_shared<OfflineSchedule>(run);
  std::map<int, int> tasks = schedule->AddTasks(graph);
  graph->KeepAlive(schedule);
  return tasks;
}

}  // namespace acmp
