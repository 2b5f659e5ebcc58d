#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"

namespace acmp {

/// Tasks that wait for others, done by several threads.
class TaskGraph {
 public:
  /// Adds a task and returns its number. It runs once the tasks `after`, of smaller numbers, are done.
  /// @param pool which threads do it
  /// @param rank of those that are ready a pool takes the least rank first, and then the smallest number
  /// @param work is told the number of its thread in the pool
  int Add(int pool, int rank, const std::vector<int>& after, std::function<void(int)> work);

  /// Does all tasks with threads[p] threads, at least one, for pool p. No pools: the caller's own thread does all, in
  /// the same order. Throws what a task threw first, or Interrupted, or std::system_error where a thread cannot be
  /// started, when all threads have stopped. Once per graph.
  void Run(const std::vector<int>& threads, const StopRequest& interrupt);

 private:
  struct Task {
    size_t pool = 0;
    int rank = 0;
    int waits_for = 0;  ///< tasks that are not done
    std::vector<int> followers;
    std::function<void(int)> work;
  };

  void Work(size_t pool, int thread, const StopRequest& interrupt);
  void MakeReady(int number);
  int Next(size_t pool);
  void Finish(int number);
  void Fail(std::exception_ptr failure);

  std::vector<Task> tasks_;

  std::mutex mutex_;  ///< of all below, and of waits_for
  std::condition_variable changed_;
  std::vector<std::set<std::pair<int, int>>> ready_;  ///< rank and number, per pool
  size_t left_ = 0;                                   ///< tasks
  std::exception_ptr failure_;
};

/// What a run, a stage or a reconstruction in memory computes, as tasks of one graph: a step of an image, its maps, its
/// points. Each waits for just what it reads of the others; what no task makes is in the store. Each is done on the
/// image's device, and each engine works on another image. The store is told who reads which estimate, so that it can
/// forget them.
class RunTasks {
 public:
  /// With the steps after which images have estimates of a step, as far as they are not in whole files: a warning names
  /// damaged ones. Steps go first that are farther on, so that the first images are finished, written and forgotten
  /// while the last ones are still to come.
  /// @param run not null; it outlives this, and its plan stays as it is
  /// @param step -1: none
  /// @param images with a map, by scene index; all that other tasks read
  RunTasks(ReconstructRun* run, int step, const std::set<int>& images);

  size_t steps() const { return steps_.size(); }

  /// Adds the task that fetches an image's final maps.
  /// @param measure also their confidence; else it stays empty
  /// @param take gets them in the task's thread
  int AddMaps(const ImagePlan& image, bool measure, std::function<void(FinalMaps)> take);

  /// Adds the fusion of the next view. It reads and writes the stamps of its frames: for each it waits for the view
  /// that did so last, and with that for all before. So it finds the stamps that it would find if the views were fused
  /// one after the other. Points are in coordinates that begin at the plan's origin. Throws InvalidInputError when
  /// there are more images than a fusion can tell apart. Returns the task's number.
  /// @param after further tasks that it waits for
  /// @param take gets the points in the task's thread
  int AddFusion(const ImagePlan& image, std::vector<int> after, std::function<void(PointCloud)> take);

  /// Adds a task for the threads that write files.
  int AddFileTask(const std::vector<int>& after, std::function<void()> work, bool urgent = false);

  /// Does all that was added, once; throws as TaskGraph::Run.
  void Run() { graph_.Run(run_.devices.PoolThreads(), run_.interrupt); }

 private:
  using StepOfImage = EngineStore::Key;

  std::set<StepOfImage> MissingSteps(int step, std::set<int> read) const;
  void AddStep(int step, const ImagePlan& image);
  std::vector<int> StepsRead(int step, const ImagePlan& image) const;
  void DoStep(int step, const ImagePlan& image, const DeviceEngine& engine, DepthEstimator* estimator);
  PointCloud Fuse(const ImagePlan& image, int rank, const DeviceEngine& engine);

  ReconstructRun& run_;
  const int final_step_;
  TaskGraph graph_;
  std::map<int, int> device_of_;                         ///< by scene index
  std::vector<std::vector<DepthEstimator>> estimators_;  ///< per device and engine
  std::map<StepOfImage, int> steps_;                     ///< their tasks
  std::unique_ptr<FusionStamps> stamps_;
  int views_ = 0;                  ///< that are fused
  std::map<int, int> last_fused_;  ///< the last task that uses the stamps of a frame
};

}  // namespace acmp
