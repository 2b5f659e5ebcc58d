#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"
#include "task_graph.h"

namespace acmp {

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
  /// @param take gets the points in the task's thread
  int AddFusion(const ImagePlan& image, std::function<void(PointCloud)> take);

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
