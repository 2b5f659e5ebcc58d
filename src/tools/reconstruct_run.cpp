#include "reconstruct_run.h"

namespace acmp {

void RunTimes::Add(const StageTimes& other) { stages += other; }

FrameStore::FrameStore(const Scene& scene, int max_image_size, size_t max_bytes)
    : scene_(scene), max_image_size_(max_image_size), cache_(max_bytes) {}

FramePtr FrameStore::Get(int index) {
  return cache_.Get(
      index, [&] { return std::make_shared<const Frame>(LoadFrame(scene_, index, max_image_size_)); },
      [](const Frame& frame) { return frame.gray.size() * sizeof(float) + frame.color.size() * sizeof(Rgb); });
}

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
