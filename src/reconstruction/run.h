#pragma once

#include <map>
#include <mutex>
#include <vector>

#include "acmp_mapping/dataset/scene.h"
#include "reconstruct_engine.h"
#include "reconstruct_folder.h"
#include "reconstruct_interrupt.h"
#include "reconstruct_options.h"
#include "reconstruct_plan.h"
#include "reconstruct_progress.h"
#include "reconstruct_store.h"
#include "reconstruct_tasks.h"

namespace acmp {

/// Wall time of this run in milliseconds, summed over images.
struct RunTimes {
  StageTimes stages;
  double consistency_ms = 0;  ///< confidence maps
  double fusion_ms = 0;       ///< point cloud
  double reading_ms = 0;      ///< images, and estimates of stages before
  double keeping_ms = 0;      ///< estimates and final maps, from the device and to work files
  double writing_ms = 0;      ///< maps and pictures
  double cloud_ms = 0;        ///< the cloud's file
  double syncing_ms = 0;      ///< waiting for the disk
  double run_ms = 0;          ///< the whole run, from the scene's files to the last one; not a sum
  int images = 0;             ///< whose stages are in here; fewer than all after an interruption
  void Add(const StageTimes& other);
};

/// Camera of an image at the size of the run.
PinholeCamera CameraOf(const Scene& scene, int index, int max_image_size);

/// What all steps of one run share. Everything outlives the steps.
struct ReconstructRun {
  const Scene& scene;
  const ReconstructOptions& options;
  ReconstructPlan& plan;
  const ReconstructFolder& folder;
  const std::vector<ReconstructEngine>& engines;  ///< at least one
  EngineStore& store;
  InterruptWatcher& interrupt;
  Progress& progress;
  RunTimes times;
  std::mutex times_mutex;
};

/// Relative costs of the steps of one image, for the progress display: what they take on a GPU, roughly.
struct StepCosts {
  static constexpr double kInitialWithoutPrior = 0.5;
  static constexpr double kInitialWithPrior = 1.0;
  static constexpr double kGeometricPass = 0.35;
  static constexpr double kCompletion = 0.05;
  static constexpr double kOutput = 0.3;
  static constexpr double kFusion = 0.1;
};
/// Of an image's final estimate.
double EstimateCost(const PipelineOptions& pipeline);
double TotalCost(const ReconstructPlan& plan, const PipelineOptions& pipeline);

/// Which threads do a task.
enum TaskPool {
  kHostPool,        ///< those that write files
  kFirstEnginePool  ///< one pool per device, one thread per engine of it; then one per device with a thread that fuses
};

int NumDevices(const ReconstructRun& run);
/// The device that works on the image at a place of the plan. Stretches of up to 16 images, of about the same length,
/// go to one device after the other: neighbours, which mostly see the same, are on the same one, and all devices are at
/// about the same place of the scene, so that few points wait for those of earlier images.
/// @param place below `images`; `devices` at least 1
/// @return the device's number, from 0
int DeviceOfPlace(size_t place, size_t images, size_t devices);
/// The device that works on an image, 0..NumDevices - 1.
int DeviceOf(const ReconstructRun& run, int index);
/// Its pools.
int EnginePoolOf(const ReconstructRun& run, int index);
int FusionPoolOf(const ReconstructRun& run, int index);
/// Number of the engine of a pool's thread; of the only one where no threads are in use.
int EngineOf(const ReconstructRun& run, int pool, int thread);
/// Threads of all pools; none on the CPU, whose engine uses all cores itself.
std::vector<int> PoolThreads(const ReconstructRun& run);

/// Adds Algorithm 1 over all images to the graph: initial estimates, then geometric passes in Jacobi order. Leaves
/// final maps in the folder. Returns the tasks after which they are there, by scene index.
std::map<int, int> AddOfflineSchedule(ReconstructRun* run, TaskGraph* graph);

/// Feeds the images in the order of their index to a DenseMapper. Leaves final maps in the folder.
void RunOnlineSchedule(ReconstructRun* run);

/// Writes cameras.txt: cameras and poses of the maps.
void WriteCameraList(const ReconstructRun& run, const std::vector<int>& images);

/// Runs what is in the graph and then, or meanwhile, the output: confidence, map files and pictures of every image with
/// final maps; the fused cloud and the cameras.
/// @param final_maps tasks that an image's final maps wait for, by scene index; none: they are there
/// @return number of points
size_t RunAndWriteResults(ReconstructRun* run, const std::map<int, int>& final_maps, TaskGraph* graph);

}  // namespace acmp
