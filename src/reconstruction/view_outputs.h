#pragma once

#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"

namespace acmp {

/// Tasks after which the final estimates of an image and of its source views are there.
/// @param final_maps the task of each image, by scene index; none: they are there
std::vector<int> TasksOfMapsRead(const ReconstructPlan& plan, const ImagePlan& image,
                                 const std::map<int, int>& final_maps);

/// The problem with the poses of coordinates that begin at the origin.
EngineProblem InLocalCoordinates(EngineProblem problem, const Eigen::Vector3d& origin);

/// Adds the task that measures the confidence of an image's final estimate, on the image's device, and returns its
/// number. Announces to the store that it reads estimates.
/// @param image of the run's plan
/// @param take gets it in the task's thread
int AddConfidence(ScheduleRun* run, const ImagePlan& image, const std::vector<int>& after, TaskGraph* graph,
                  std::function<void(ConfidenceMap)> take);

/// The fusion of a run's views in their order. Points are in coordinates that begin at the plan's origin.
class ViewFusion {
 public:
  /// Throws InvalidInputError when there are more images than a fusion can tell apart.
  /// @param run not null; outlives this, and this the tasks
  explicit ViewFusion(ScheduleRun* run);

  /// Adds the fusion of the next view, on the device of its image, and returns the task's number. It reads and writes
  /// the stamps of its frames: for each it waits for the view that did so last, and with that for all before. So it
  /// finds the stamps that it would find if the views were fused one after the other. Announces to the store that it
  /// reads estimates.
  /// @param image of the run's plan
  /// @param take gets the points in the task's thread
  int AddTask(const ImagePlan& image, std::vector<int> after, TaskGraph* graph, std::function<void(PointCloud)> take);

 private:
  PointCloud Fuse(const ImagePlan& image, int rank, const DeviceEngine& engine);

  ScheduleRun& run_;
  const FusionOptions options_;
  const std::unique_ptr<FusionStamps> stamps_;
  int views_ = 0;
  std::map<int, int> last_fused_;  ///< the last task that uses the stamps of a frame
};

}  // namespace acmp
