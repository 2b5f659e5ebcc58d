#include <tbb/parallel_for.h>

#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "run.h"

namespace acmp {
namespace {

/// The steps of the offline schedule. A step's result of an image is one file, or on a GPU only in its memory
/// (EngineStore::Keep): after an interruption what has no file and is still read is made again. Each engine works on
/// another image; a refinement waits for the estimates it reads.
class OfflineSchedule {
 public:
  using Key = EngineStore::Key;  ///< step, scene index

  explicit OfflineSchedule(ScheduleRun* run) : run_(*run), final_step_(run->store.final_step()) {
    for (const ImagePlan& image : run_.plan.images) {
      if (image.no_map.empty()) images_[image.index] = &image;
    }
    const PipelineOptions pipeline = MakePipelineOptions(run->options);
    for (int device = 0; device < run_.devices.size(); ++device) {
      estimators_.emplace_back();
      for (int i = 0; i < run_.devices.NumEngines(device); ++i) {
        estimators_.back().emplace_back(run_.devices.Engine(device, i).engine, pipeline);
      }
    }
  }

  /// Returns the tasks of these steps.
  std::map<Key, int> AddSteps(const std::set<Key>& steps, TaskGraph* graph) {
    for (const Key& key : steps) {  // a step's comes after all of the step before
      const auto [step, index] = key;
      const ImagePlan& image = *images_.at(index);
      std::vector<int> after;
      for (int read : step > 0 ? ImagesRead(image) : std::vector<int>()) {
        if (const auto task = tasks_.find({step - 1, read}); task != tasks_.end()) after.push_back(task->second);
      }
      const int device = run_.devices.DeviceOf(index);
      tasks_[key] = graph->Add(Devices::EnginePool(device), after, [this, step = step, &image, device](int thread) {
        Run(step, image, device, thread);
        run_.progress.Step();
      });
    }
    return tasks_;
  }

  /// Returns the tasks of the last step, by scene index.
  /// An image's refinements are numbered as early as what they read allows, so that the first images are finished,
  /// written and forgotten while the last ones are still to come. On several devices neighbours in the order of the
  /// scene, which mostly see the same, are on the same one.
  std::map<int, int> AddTasks(TaskGraph* graph) {
    FindWhatIsToDo();
    for (const auto& [index, image] : images_) {
      for (int read : ImagesRead(*image)) readers_[read].push_back(index);
      for (int step = 0; step < final_step_; ++step) run_.store.AddReaders(*image, step, 1);
    }
    for (const auto& [index, image] : images_) AddWithReaders({0, index}, graph);
    std::map<int, int> last;
    for (const auto& [index, image] : images_) last[index] = tasks_.at({final_step_, index});
    return last;
  }

 private:
  std::vector<int> ImagesRead(const ImagePlan& image) const { return run_.plan.ImagesRead(image); }

  /// Those without a whole file whose results are final or read by others that are to do. Damaged files are named.
  void FindWhatIsToDo() {
    std::set<int> all;
    for (const auto& [index, image] : images_) all.insert(index);
    const auto file_of = [&](const Key& key) { return run_.store.FileOf(key); };
    to_do_ = StepsToDo(
        final_step_, all, file_of, [&](int index) { return ImagesRead(*images_.at(index)); }, run_.interrupt,
        [&](const Key& key) {
          WarnOfDamage(file_of(key), run_.scene.images[static_cast<size_t>(key.second)].name, &run_.progress);
        });
  }

  /// Adds a step, and then those that waited for it last.
  void AddWithReaders(const Key& key, TaskGraph* graph) {
    const auto [step, index] = key;
    const ImagePlan& image = *images_.at(index);
    std::vector<int> after;
    if (step > 0) {
      for (int read : ImagesRead(image)) after.push_back(tasks_.at({step - 1, read}));
    }
    const bool done = to_do_.count(key) == 0;
    const int device = run_.devices.DeviceOf(index);
    tasks_[key] = graph->Add(Devices::EnginePool(device), after, [this, step = step, &image, done, device](int thread) {
      if (!done) Run(step, image, device, thread);
      if (step > 0) run_.store.HasRead(image, step - 1);
      run_.progress.Step(done);
    });
    if (step == final_step_) return;
    for (int reader : readers_.at(index)) {
      const size_t ready = ++ready_[{step + 1, reader}];
      if (ready == ImagesRead(*images_.at(reader)).size()) AddWithReaders({step + 1, reader}, graph);
    }
  }

  void Run(int step, const ImagePlan& image, int device, int thread) {
    const DeviceEngine engine = run_.devices.Engine(device, thread);
    DepthEstimator& estimator = estimators_.at(device).at(thread);
    Timer timer;
    const EngineProblem problem =
        step == 0 ? run_.store.Problem(image, engine) : run_.store.Problem(image, step - 1, engine);
    const double reading_ms = timer.Lap();
    run_.interrupt.Check();
    const EngineEstimatePtr estimate = estimator.Run(estimator.schedule()[static_cast<size_t>(step)], problem);
    run_.interrupt.Check();
    timer.Lap();
    run_.store.Keep(step, *problem.reference.frame, engine, estimate);
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    run_.times.stages += estimator.last_times();
    if (step == final_step_ && !estimator.prior_depth_rejection().empty()) {
      run_.prior_depth_rejections[image.index] = estimator.prior_depth_rejection();
    }
    run_.times.images += step == 0 ? 1 : 0;
    run_.times.reading_ms += reading_ms;
    run_.times.keeping_ms += timer.Lap();
  }

  ScheduleRun& run_;
  const int final_step_;
  std::map<int, const ImagePlan*> images_;               ///< that get a map, by scene index
  std::vector<std::vector<DepthEstimator>> estimators_;  ///< per device and engine
  std::set<Key> to_do_;  ///< the others have files, or nobody reads their results any more
  std::map<Key, int> tasks_;
  std::map<int, std::vector<int>> readers_;  ///< images whose refinements read the image's estimates
  std::map<Key, size_t> ready_;              ///< how many of what a step reads have been added
};

}  // namespace

std::set<EngineStore::Key> StepsToDo(int step, const std::set<int>& wanted,
                                     const std::function<std::filesystem::path(const EngineStore::Key&)>& file_of,
                                     const std::function<std::vector<int>(int)>& images_read,
                                     const StopRequest& interrupt,
                                     const std::function<void(const EngineStore::Key&)>& on_damaged) {
  std::set<EngineStore::Key> to_do;
  std::set<int> read = wanted;  // of the step's results, by scene index
  for (; step >= 0; --step) {
    const std::vector<int> images(read.begin(), read.end());
    std::vector<WorkFileState> files(images.size());
    tbb::parallel_for(size_t{0}, images.size(), [&](size_t i) {
      interrupt.Check();
      files[i] = CheckWorkFile(file_of({step, images[i]}));
    });
    read.clear();
    for (size_t i = 0; i < images.size(); ++i) {
      if (files[i] == WorkFileState::kWhole) continue;
      const EngineStore::Key key = {step, images[i]};
      if (files[i] == WorkFileState::kDamaged) on_damaged(key);
      to_do.insert(key);
      for (int other : images_read(images[i])) read.insert(other);
    }
  }
  return to_do;
}

void WarnOfDamage(const std::filesystem::path& file, const std::string& image, Progress* progress) {
  progress->Warn(
      Concat("the work file ", file.string(), " is damaged: its step of image ", image, " is computed again"));
}

std::map<EngineStore::Key, int> AddOfflineSteps(ScheduleRun* run, const std::set<EngineStore::Key>& steps,
                                                TaskGraph* graph) {
  const auto schedule = std::make_shared<OfflineSchedule>(run);
  graph->KeepAlive(schedule);
  return schedule->AddSteps(steps, graph);
}

std::map<int, int> AddOfflineSchedule(ScheduleRun* run, TaskGraph* graph) {
  const auto schedule = std::make_shared<OfflineSchedule>(run);
  std::map<int, int> tasks = schedule->AddTasks(graph);
  graph->KeepAlive(schedule);
  return tasks;
}

}  // namespace acmp
