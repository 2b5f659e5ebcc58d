#pragma once

#include "acmp_mapping/dataset/scene.h"
#include "reconstruct_engine.h"
#include "reconstruct_folder.h"
#include "reconstruct_interrupt.h"
#include "reconstruct_lru_cache.h"
#include "reconstruct_options.h"
#include "reconstruct_plan.h"
#include "reconstruct_progress.h"

namespace acmp {

/// Wall time of this run in milliseconds, summed over images.
struct RunTimes {
  StageTimes stages;
  double consistency_ms = 0;  ///< confidence maps
  double fusion_ms = 0;       ///< point cloud
  double io_ms = 0;           ///< reading images, reading and writing maps
  int images = 0;             ///< whose stages are in here; fewer than all after an interruption
  void Add(const StageTimes& other);
};

/// Images of a scene at the size of the run, the ones used last kept in memory. For any number of threads.
class FrameStore {
 public:
  FrameStore(const Scene& scene, int max_image_size, size_t max_bytes);
  FramePtr Get(int index);

 private:
  const Scene& scene_;
  int max_image_size_;
  LruCache<int, Frame> cache_;
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
  InterruptWatcher& interrupt;
  Progress& progress;
  RunTimes times;
};

/// Relative costs of the steps of one image, for the progress display: what they take on a GPU, roughly.
struct StepCosts {
  static constexpr double kInitialWithoutPrior = 0.5;
  static constexpr double kInitialWithPrior = 1.0;
  static constexpr double kGeometricPass = 0.35;
  static constexpr double kOutput = 0.3;
  static constexpr double kFusion = 0.1;
};
double TotalCost(const ReconstructPlan& plan, const PipelineOptions& pipeline);

/// Algorithm 1 over all images: initial estimates, then geometric passes in Jacobi order. Leaves final maps in the
/// folder.
void RunOfflineSchedule(ReconstructRun* run);

/// Feeds the images in the order of their index to a DenseMapper. Leaves final maps in the folder.
void RunOnlineSchedule(ReconstructRun* run);

/// Confidence, map files and pictures of every image with final maps; then the fused cloud and the cameras.
/// @return number of points
size_t WriteResults(ReconstructRun* run);

}  // namespace acmp
