#include "view_outputs.h"

#include <mutex>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/fusion/fusion_setup.h"

namespace acmp {
namespace {

ConfidenceMap MeasureConfidence(ScheduleRun* run, const ImagePlan& image, const FusionOptions& options,
                                const DeviceEngine& engine) {
  const EngineProblem problem = run->store.Problem(image, run->store.final_step(), engine);
  Timer timer;
  ConfidenceMap confidence = engine.engine->MeasureConfidence(problem.reference, problem.sources, options);
  run->interrupt.Check();
  run->store.HasRead(image, run->store.final_step());
  const std::lock_guard<std::mutex> lock(run->times_mutex);
  run->times.consistency_ms += timer.Lap();
  return confidence;
}

}  // namespace

std::vector<int> TasksOfMapsRead(const ReconstructPlan& plan, const ImagePlan& image,
                                 const std::map<int, int>& final_maps) {
  std::vector<int> tasks;
  if (final_maps.empty()) return tasks;
  for (int read : plan.ImagesRead(image)) tasks.push_back(final_maps.at(read));
  return tasks;
}

EngineProblem InLocalCoordinates(EngineProblem problem, const Eigen::Vector3d& origin) {
  if (origin.isZero(0)) return problem;
  const auto move = [&](EngineView* view) {
    RigidTransform pose = view->cam_from_world();
    pose.translation() += pose.linear() * origin;
    view->refined_pose = pose;
  };
  move(&problem.reference);
  for (EngineView& source : problem.sources) move(&source);
  return problem;
}

int AddConfidence(ScheduleRun* run, const ImagePlan& image, const std::vector<int>& after, TaskGraph* graph,
                  std::function<void(ConfidenceMap)> take) {
  run->store.AddReaders(image, run->store.final_step(), 1);
  const int device = run->devices.DeviceOf(image.index);
  const FusionOptions options = MakePipelineOptions(run->options).fusion;
  const auto measure = [run, &image, device, options, take = std::move(take)](int thread) {
    take(MeasureConfidence(run, image, options, run->devices.Engine(device, thread)));
  };
  return graph->Add(Devices::EnginePool(device), after, measure, true);
}

ViewFusion::ViewFusion(ScheduleRun* run)
    : run_(*run),
      options_(MakePipelineOptions(run->options).fusion),
      stamps_(run->devices.FusionEngine(0).engine->MakeFusionStamps()) {
  CheckRange("number of images to fuse", static_cast<int>(run_.plan.images.size()), 0, kMaxFusionViews);
}

int ViewFusion::AddTask(const ImagePlan& image, std::vector<int> after, TaskGraph* graph,
                        std::function<void(PointCloud)> take) {
  run_.store.AddReaders(image, run_.store.final_step(), 1);
  const std::vector<int> frames = run_.plan.ImagesRead(image);
  for (int frame : frames) {
    if (const auto last = last_fused_.find(frame); last != last_fused_.end()) after.push_back(last->second);
  }
  const int rank = views_++;
  const int device = run_.devices.DeviceOf(image.index);
  const int task =
      graph->Add(run_.devices.FusionPool(device), after, [this, rank, device, &image, take = std::move(take)](int) {
        take(Fuse(image, rank, run_.devices.FusionEngine(device)));
      });
  for (int frame : frames) last_fused_[frame] = task;
  return task;
}

PointCloud ViewFusion::Fuse(const ImagePlan& image, int rank, const DeviceEngine& engine) {
  const EngineProblem problem =
      InLocalCoordinates(run_.store.Problem(image, run_.store.final_step(), engine), run_.plan.origin);
  Timer timer;
  PointCloud cloud = engine.engine->FuseView(problem.reference, problem.sources, options_, rank, stamps_.get());
  run_.interrupt.Check();
  run_.store.HasRead(image, run_.store.final_step());
  run_.progress.Step();
  const std::lock_guard<std::mutex> lock(run_.times_mutex);
  run_.times.fusion_ms += timer.Lap();
  return cloud;
}

}  // namespace acmp
