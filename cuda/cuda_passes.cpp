#include "cuda_passes.h"

#include <memory>
#include <mutex>
#include <shared_mutex>

#include "map_kernels.h"

namespace acmp {

template <Pass kPass>
EngineEstimatePtr CudaPasses::Run(const EngineProblem& problem, const PatchMatchOptions& options, int level,
                                  const EngineEstimatePtr& start, const PriorMesh* prior, int geometric_pass,
                                  int iterations) {
  Validate(options);
  const PatchMatchProblem match = MakePatchMatchProblem(problem, level);
  const PinholeCamera& camera = match.reference.camera;
  if (kPass != Pass::kPhotometric) {
    const CudaEstimate& from = queue_.Cast<CudaEstimate>(start);
    CheckSize("start", from.width, from.height, camera);
  }
  return queue_.OnDevice([&] {
    CudaDevice& device = *queue_.device();
    const size_t pixels = static_cast<size_t>(camera.width) * camera.height;
    DeviceArray<uint32_t> selected_views;  // only where the prior's numbers have the place of the depths
    if (prior != nullptr) {
      prior_.Upload(*prior);
      selected_views = DeviceArray<uint32_t>(queue_.device(), pixels);
    }
    const std::shared_ptr<CudaEstimate> estimate =
        kPass == Pass::kPhotometric ? std::make_shared<CudaEstimate>(queue_.device(), camera) : Continue(start, queue_);
    const std::unique_lock<std::mutex> turn = device.PassTurn(pixels);
    const std::shared_lock<std::shared_mutex> images(device.images_mutex());
    CudaMatchContext context = context_.Prepare(problem, match, level, options, kPass, geometric_pass, estimate.get());
    if (prior != nullptr) {
      context.selected_views.data = selected_views.data();
      context.prior = prior_.MapIn(estimate.get());
    }
    queue_.StartClock();
    if (prior != nullptr) prior_.QueueDrawing(match, estimate->NumbersView());
    VisitMethod<kPass>(options.method,
                       [&](auto method) { LaunchPass<kPass, method>(context, iterations, queue_.stream().get()); });
    if (kPass == Pass::kGeometric && options.method == Method::kOurs) {
      halved_.Finish(camera, estimate.get());
    } else {
      QueueDepths(camera, estimate.get(), queue_.stream());
      queue_.FinishClock();
    }
    return EngineEstimatePtr(estimate);
  });
}

EngineEstimatePtr CudaPasses::RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                             int level) {
  return Run<Pass::kPhotometric>(problem, options, level, nullptr, nullptr, 0, options.photometric_iterations);
}

EngineEstimatePtr CudaPasses::RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                             const EngineEstimatePtr& start, const PriorMesh& prior) {
  return Run<Pass::kPlanarPrior>(problem, options, 0, start, &prior, 0, options.planar_prior_iterations);
}

EngineEstimatePtr CudaPasses::RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                           const EngineEstimatePtr& start, int pass) {
  const CudaEstimate& from = queue_.Cast<CudaEstimate>(start);
  const int level = LevelOf(problem, from.width, from.height);
  return Run<Pass::kGeometric>(problem, options, level, start, nullptr, pass, options.geometric_iterations);
}

EngineEstimatePtr CudaPasses::RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                             const EngineEstimatePtr& start, const EngineEstimatePtr& coarser) {
  Validate(options);
  const CudaEstimate& from = queue_.Cast<CudaEstimate>(start);
  const int level = LevelOf(problem, from.width, from.height);
  const PatchMatchProblem match = MakePatchMatchProblem(problem, level);
  const PinholeCamera& camera = match.reference.camera;
  const PinholeCamera halved = camera.Halved();
  const CudaEstimate& halved_estimate = queue_.Cast<CudaEstimate>(coarser);
  CheckSize("coarser estimate", halved_estimate.width, halved_estimate.height, halved);
  return queue_.OnDevice([&] {
    const std::shared_ptr<CudaEstimate> estimate = Continue(start, queue_);
    const std::unique_lock<std::mutex> turn = queue_.device()->PassTurn(estimate->Pixels());
    const std::shared_lock<std::shared_mutex> images(queue_.device()->images_mutex());
    const CudaMatchContext context =
        context_.Prepare(problem, match, level, options, Pass::kPhotometric, 0, estimate.get());
    queue_.StartClock();
    LaunchRestoreDetails(context, {halved_estimate.PlaneView(), MakeRayGrid(halved)}, queue_.stream().get());
    QueueDepths(camera, estimate.get(), queue_.stream());
    queue_.FinishClock();
    return EngineEstimatePtr(estimate);
  });
}

EngineEstimatePtr CudaPasses::Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) {
  const CudaEstimate& halved = queue_.Cast<CudaEstimate>(estimate);
  CheckUpsample(frame, level, halved.width, halved.height);
  return queue_.OnDevice([&] {
    auto full = std::make_shared<CudaEstimate>(queue_.device(), frame->camera);
    queue_.StartClock();
    LaunchUpsample({halved.PlaneView(), halved.cost.data(), MakeRayGrid(CameraAtLevel(frame->camera, level)), level},
                   MakeRayGrid(frame->camera), full->PlaneView(), full->cost.data(), queue_.stream().get());
    QueueDepths(frame->camera, full.get(), queue_.stream());
    queue_.FinishClock();
    return EngineEstimatePtr(full);
  });
}

}  // namespace acmp
