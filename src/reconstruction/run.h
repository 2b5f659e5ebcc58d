#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/camera_list.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "acmp_mapping/reconstruction/stop_request.h"
#include "cloud_output.h"
#include "devices.h"
#include "engine_store.h"
#include "output_folder.h"
#include "plan.h"
#include "progress.h"
#include "task_graph.h"

namespace acmp {

/// Wall time of this run in milliseconds, summed over images.
struct RunTimes {
  StageTimes stages;
  double consistency_ms = 0;  ///< confidence maps
  double fusion_ms = 0;       ///< point cloud
  double reading_ms = 0;      ///< images, and estimates of steps before
  double keeping_ms = 0;      ///< estimates and final maps, from the device and to work files
  double writing_ms = 0;      ///< maps and pictures
  double cloud_ms = 0;        ///< the cloud's file
  double syncing_ms = 0;      ///< waiting for the disk
  double run_ms = 0;          ///< the whole run, from the scene's files to the last one; not a sum
  int images = 0;             ///< whose steps are in here; fewer than all after an interruption
};

/// What all steps of one run share. Everything outlives the steps.
struct ScheduleRun {
  Scene& scene;  ///< the online schedule puts refined poses into it
  const ReconstructOptions& options;
  ReconstructPlan& plan;
  const Devices& devices;
  EngineStore& store;
  StopRequest& interrupt;
  Progress& progress;
  RunTimes times;
  std::map<int, std::string> prior_depth_rejections;  ///< why the prior depth of images is not used, by scene index
  std::mutex times_mutex;                             ///< of times and rejections
};

/// A run whose results are files.
struct ReconstructRun : ScheduleRun {
  const OutputFolder& folder;
};

/// Steps of images whose work files are missing or damaged though they are wanted or read by others that are to do.
/// @param wanted images, by scene index, whose estimates after the step are wanted
/// @param file_of where an estimate is if it is in a file
/// @param images_read of an image: those whose estimates of the step before its refinement reads
/// @param on_damaged is told of damaged files, which are to do
std::set<EngineStore::Key> StepsToDo(int step, const std::set<int>& wanted,
                                     const std::function<std::filesystem::path(const EngineStore::Key&)>& file_of,
                                     const std::function<std::vector<int>(int)>& images_read,
                                     const StopRequest& interrupt,
                                     const std::function<void(const EngineStore::Key&)>& on_damaged);
/// Says that a damaged file is made again.
void WarnOfDamage(const std::filesystem::path& file, const std::string& image, Progress* progress);

/// Adds Algorithm 1 over all images to the graph: initial estimates, then refinements in Jacobi order. Leaves final
/// estimates in the store. Returns the tasks after which they are there, by scene index.
std::map<int, int> AddOfflineSchedule(ScheduleRun* run, TaskGraph* graph);

/// Adds only these steps, and leaves their estimates in the store; what they read beside each other is in files.
/// Returns their tasks.
std::map<EngineStore::Key, int> AddOfflineSteps(ScheduleRun* run, const std::set<EngineStore::Key>& steps,
                                                TaskGraph* graph);

/// Feeds the images in the order of their index to a DenseMapper. Leaves final maps in the folder.
void RunOnlineSchedule(ReconstructRun* run);

/// Runs what is in the graph and then, or meanwhile, the output: confidence, map files and pictures of every image with
/// final maps; the fused cloud and the cameras.
/// @param final_maps tasks that an image's final maps wait for, by scene index; none: they are there
CloudSize RunAndWriteResults(ReconstructRun* run, const std::map<int, int>& final_maps, TaskGraph* graph);

/// Camera of an image at the size of the run.
PinholeCamera CameraOf(const ScheduleRun& run, int index);

/// Cameras of the maps, at their size, with their poses. @param images with maps, by scene index
std::vector<ListedCamera> Cameras(const ReconstructRun& run, const std::vector<int>& images);

}  // namespace acmp
