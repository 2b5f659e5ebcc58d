#include "reconstruct_run.h"

namespace acmp {

void RunTimes::Add(const StageTimes& other) { stages += other; }

PinholeCamera CameraOf(const Scene& scene, int index, int max_image_size) {
  const PinholeCamera& camera = scene.images[index].camera;
  int width = camera.width;
  int height = camera.height;
  LimitSize(max_image_size, &width, &height);
  return camera.Resized(width, height);
}

double TotalCost(const ReconstructPlan& plan, const PipelineOptions& pipeline) {
  const double initial = pipeline.use_planar_prior ? StepCosts::kInitialWithPrior : StepCosts::kInitialWithoutPrior;
  const double per_image =
      initial + pipeline.geometric_passes * StepCosts::kGeometricPass + StepCosts::kOutput + StepCosts::kFusion;
  double total = 0;
  for (const ImagePlan& image : plan.images) total += image.no_map.empty() ? per_image : 0.0;
  return total;
}

}  // namespace acmp
