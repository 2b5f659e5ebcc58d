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

/// A step of the schedule of an image: number of the step, scene index.
using StepOfImage = EngineStore::Key;

/// Steps of images whose work files are missing or damaged though they are wanted or read by others that are to do. A
/// warning names damaged ones.
/// @param output has the work files
/// @param step of the schedule with this last step; -1: none
/// @param wanted images, by scene index, whose estimates after the step are wanted
std::set<StepOfImage> StepsToDo(const std::filesystem::path& output, const ReconstructPlan& plan, const Scene& scene,
                                int step, int final_step, const std::set<int>& wanted, const StopRequest& interrupt,
                                Progress* progress);

/// What a run computes, as tasks of one graph: a step of an image, its confidence, its points. Each waits for just what
/// it reads of the others; what no task makes is in the store. Each is done on the image's device, and each engine
/// works on another image. The store is told who reads which estimate, so that it can forget them.
class RunTasks {
 public:
  /// @param run not null; it outlives this, and its plan stays as it is
  explicit RunTasks(ReconstructRun* run) : run_(*run), final_step_(run->store.final_step()) {}

  /// Adds steps, once. They are numbered as early as what they read allows, so that the first images are finished,
  /// written and forgotten while the last ones are still to come.
  void AddSteps(const std::set<StepOfImage>& steps);
  /// Adds those that the final estimates of all images need and that are not in whole files, and returns them.
  std::set<StepOfImage> AddMissingSteps();
  /// The tasks after which the final estimates of an image and of its source views are there.
  std::vector<int> FinalStepsRead(const ImagePlan& image) const;

  /// Adds the task that measures the confidence of an image's final estimate.
  /// @param take gets it in the task's thread
  int AddConfidence(const ImagePlan& image, std::function<void(ConfidenceMap)> take);

  /// Adds the fusion of the next view. It reads and writes the stamps of its frames: for each it waits for the view
  /// that did so last, and with that for all before. So it finds the stamps that it would find if the views were fused
  /// one after the other. Points are in coordinates that begin at the plan's origin. Throws InvalidInputError when
  /// there are more images than a fusion can tell apart. Returns the number of the task that hands out the points.
  /// @param take gets them in a thread that writes files
  int AddFusion(const ImagePlan& image, std::function<void(PointCloud)> take);
  /// Before the first AddFusion: these pixels of a frame have gone into points of earlier views (DepthEngine).
  void SetFusedPixels(const Frame& frame, const Image<unsigned char>& used);
  /// Those that have after Run.
  Image<unsigned char> FusedPixels(const Frame& frame);

  /// Adds a task for the threads that write files.
  int AddFileTask(const std::vector<int>& after, std::function<void()> work, bool urgent = false);

  /// Does all that was added, once; throws as TaskGraph::Run.
  void Run() { graph_.Run(run_.devices.PoolThreads(), run_.interrupt); }

 private:
  std::vector<int> StepsRead(int step, const ImagePlan& image) const;
  void DoStep(int step, const ImagePlan& image, const DeviceEngine& engine, DepthEstimator* estimator);
  PointCloud Fuse(const ImagePlan& image, int rank, const DeviceEngine& engine);
  FusionStamps* stamps();

  ReconstructRun& run_;
  const int final_step_;
  TaskGraph graph_;
  std::vector<std::vector<DepthEstimator>> estimators_;  ///< per device and engine; none: no steps
  std::map<StepOfImage, int> steps_;                     ///< their tasks
  std::unique_ptr<FusionStamps> stamps_;
  int views_ = 0;                  ///< that are fused, with that of the earlier ones if there are some
  std::map<int, int> last_fused_;  ///< the last task that uses the stamps of a frame
};

}  // namespace acmp
