#include "reconstruct_run.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>

namespace acmp {
namespace {

/// Devices in the order in which the engines name them.
std::vector<int> Devices(const ReconstructRun& run) {
  std::vector<int> devices;
  for (const ReconstructEngine& engine : run.engines) {
    if (devices.empty() || devices.back() != engine.device) devices.push_back(engine.device);
  }
  return devices;
}

}  // namespace

int NumDevices(const ReconstructRun& run) { return static_cast<int>(Devices(run).size()); }

int DeviceOfPlace(size_t place, size_t images, size_t devices) {
  constexpr size_t kMaxLength = 16;  // of a stretch
  const size_t rounds = (images + kMaxLength * devices - 1) / (kMaxLength * devices);
  const size_t stretches = std::min(rounds * devices, images);
  const size_t stretch = ((place + 1) * stretches - 1) / images;  // s begins at s * images / stretches, rounded down
  return static_cast<int>(stretch % devices);
}

int DeviceOf(const ReconstructRun& run, int index) {
  const auto place = std::find_if(run.plan.images.begin(), run.plan.images.end(),
                                  [&](const ImagePlan& image) { return image.index == index; }) -
                     run.plan.images.begin();
  return DeviceOfPlace(static_cast<size_t>(place), run.plan.images.size(), Devices(run).size());
}

int EnginePoolOf(const ReconstructRun& run, int index) { return kFirstEnginePool + DeviceOf(run, index); }

int FusionPoolOf(const ReconstructRun& run, int index) {
  return kFirstEnginePool + NumDevices(run) + DeviceOf(run, index);
}

int EngineOf(const ReconstructRun& run, int pool, int thread) {
  if (run.engines.front().on_host) return 0;
  const int device = Devices(run)[static_cast<size_t>(pool - kFirstEnginePool)];
  const auto first = std::find_if(run.engines.begin(), run.engines.end(),
                                  [&](const ReconstructEngine& engine) { return engine.device == device; });
  return static_cast<int>(first - run.engines.begin()) + thread;
}

std::vector<int> PoolThreads(const ReconstructRun& run) {
  if (run.engines.front().on_host) return {};
  const int writers = std::max(1, tbb::this_task_arena::max_concurrency() / 2);  // the rest triangulates
  std::vector<int> threads = {writers};
  for (int device : Devices(run)) {
    threads.push_back(
        static_cast<int>(std::count_if(run.engines.begin(), run.engines.end(),
                                       [&](const ReconstructEngine& engine) { return engine.device == device; })));
  }
  threads.resize(threads.size() + Devices(run).size(), 1);  // that fuse
  return threads;
}

void RunTimes::Add(const StageTimes& other) { stages += other; }

PinholeCamera CameraOf(const Scene& scene, int index, int max_image_size) {
  const PinholeCamera& camera = scene.images[index].camera;
  int width = camera.width;
  int height = camera.height;
  LimitSize(max_image_size, &width, &height);
  return camera.Resized(width, height);
}

double EstimateCost(const PipelineOptions& pipeline) {
  double cost = pipeline.use_planar_prior ? StepCosts::kInitialWithPrior : StepCosts::kInitialWithoutPrior;
  for (int step = 0; step < NumRefinements(pipeline); ++step) {
    const RefinementStep does = RefinementStepOf(pipeline, step);
    cost += (does.completes ? StepCosts::kCompletion : 0) + (does.pass ? StepCosts::kGeometricPass : 0);
  }
  return cost;
}

double TotalCost(const ReconstructPlan& plan, const PipelineOptions& pipeline) {
  const double per_image = EstimateCost(pipeline) + StepCosts::kOutput + StepCosts::kFusion;
  double total = 0;
  for (const ImagePlan& image : plan.images) total += image.no_map.empty() ? per_image : 0.0;
  return total;
}

}  // namespace acmp
