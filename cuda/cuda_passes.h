#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_estimate.h"
#include "cuda_image.h"
#include "cuda_prior.h"
#include "patch_match_kernels.h"

namespace acmp {

/// Makes the contexts that passes run on, of an engine's handles. Holds the memory of one at a time.
class PassContext {
 public:
  /// @param queue,halved outlive this
  PassContext(DeviceQueue* queue, HalvedDepths* halved) : queue_(*queue), halved_(*halved) {}

  /// The context of a pass over an estimate, until the next call: geometric passes read the sources' depths, the views
  /// that pixels select take the place of the estimate's depths, and there is no prior. Queues the upload of what it
  /// points to: whoever then starts the clock does not count the host's work. The caller holds images_mutex() shared
  /// from here until the stream has been waited for.
  /// @param match MakePatchMatchProblem of the problem at that level
  CudaMatchContext Prepare(const EngineProblem& problem, const PatchMatchProblem& match, int level,
                           const PatchMatchOptions& options, Pass kind, int geometric_pass, CudaEstimate* estimate) {
    const CudaDevicePtr& device = queue_.device();
    const size_t count = problem.sources.size();
    views_.Reserve(device, kMaxSourceViews);
    full_depths_.Reserve(device, kMaxSourceViews);
    SourceView* views = host_views_.Reserve<SourceView>(kMaxSourceViews);
    auto* full_depths = host_full_depths_.Reserve<ImageView<const float>>(kMaxSourceViews);
    const std::vector<SourceView> projections = MakeSourceViews(match);
    std::copy(projections.begin(), projections.end(), views);
    if (kind == Pass::kGeometric) {
      AddDepths(problem, match, options.method, views, full_depths);
      if (options.method != Method::kOurs) full_depths_.Upload(full_depths, count, queue_.stream());
    }
    views_.Upload(views, count, queue_.stream());

    CudaMatchContext context = MakeMatchContext<TextureSampler>(match, options, kind, geometric_pass);
    context.sampler.images = device->images(level).texture();
    context.sampler.reference = queue_.Cast<CudaImage>(problem.reference.image).Layer(level);
    for (size_t i = 0; i < count; ++i) {
      context.sampler.layers[i] = queue_.Cast<CudaImage>(problem.sources[i].image).Layer(level);
    }
    context.sources = views_.data();
    context.full_depths = full_depths_.data();
    context.planes = estimate->PlaneView();
    context.cost = estimate->CostView();
    context.selected_views = estimate->NumbersView();
    AddMasks(problem, level, &context);
    return context;
  }

 private:
  /// Throws InvalidInputError unless the sources' estimates are of the level.
  void AddDepths(const EngineProblem& problem, const PatchMatchProblem& match, Method method, SourceView* views,
                 ImageView<const float>* full_depths) {
    for (size_t i = 0; i < problem.sources.size(); ++i) {
      full_depths[i] = {};
      const EngineEstimatePtr& handle = problem.sources[i].estimate;
      if (!handle) continue;
      const CudaEstimate& estimate = queue_.Cast<CudaEstimate>(handle);
      CheckSize("estimate of a source view", estimate.width, estimate.height, match.sources[i].camera);
      if (method == Method::kOurs) {
        views[i].depth = halved_.Of(estimate);
      } else {
        full_depths[i] = estimate.DepthView();
      }
    }
  }
  /// Where the reference or a source has a mask.
  void AddMasks(const EngineProblem& problem, int level, CudaMatchContext* context) {
    context->mask_distance = queue_.Cast<CudaImage>(problem.reference.image).MaskDistance(level);
    auto* mask_distances = host_mask_distances_.Reserve<ImageView<const unsigned char>>(kMaxSourceViews);
    bool has_masks = false;
    for (size_t i = 0; i < problem.sources.size(); ++i) {
      mask_distances[i] = queue_.Cast<CudaImage>(problem.sources[i].image).MaskDistance(level);
      has_masks |= !mask_distances[i].empty();
    }
    if (!has_masks) return;
    mask_distances_.Reserve(queue_.device(), kMaxSourceViews);
    mask_distances_.Upload(mask_distances, problem.sources.size(), queue_.stream());
    context->source_mask_distances = mask_distances_.data();
  }

  DeviceQueue& queue_;
  HalvedDepths& halved_;
  DeviceArray<SourceView> views_;
  DeviceArray<ImageView<const float>> full_depths_;
  DeviceArray<ImageView<const unsigned char>> mask_distances_;
  PinnedBuffer host_views_, host_full_depths_, host_mask_distances_;
};

/// The passes of Algorithm 1 and the steps between two levels on the GPU.
class CudaPasses : public virtual DepthEngine {
 public:
  /// All outlive this.
  CudaPasses(DeviceQueue* queue, HalvedDepths* halved, CudaPrior* prior)
      : queue_(*queue), halved_(*halved), prior_(*prior), context_(queue, halved) {}

  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override {
    return Run<Pass::kPhotometric>(problem, options, level, nullptr, nullptr, 0, options.photometric_iterations);
  }
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) override {
    return Run<Pass::kPlanarPrior>(problem, options, 0, start, &prior, 0, options.planar_prior_iterations);
  }
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) override {
    const CudaEstimate& from = queue_.Cast<CudaEstimate>(start);
    const int level = LevelOf(problem, from.width, from.height);
    return Run<Pass::kGeometric>(problem, options, level, start, nullptr, pass, options.geometric_iterations);
  }
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override {
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
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override {
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

 private:
  template <Pass kPass>
  EngineEstimatePtr Run(const EngineProblem& problem, const PatchMatchOptions& options, int level,
                        const EngineEstimatePtr& start, const PriorMesh* prior, int geometric_pass, int iterations) {
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
      const std::shared_ptr<CudaEstimate> estimate = kPass == Pass::kPhotometric
                                                         ? std::make_shared<CudaEstimate>(queue_.device(), camera)
                                                         : Continue(start, queue_);
      const std::unique_lock<std::mutex> turn = device.PassTurn(pixels);
      const std::shared_lock<std::shared_mutex> images(device.images_mutex());
      CudaMatchContext context =
          context_.Prepare(problem, match, level, options, kPass, geometric_pass, estimate.get());
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

  DeviceQueue& queue_;
  HalvedDepths& halved_;
  CudaPrior& prior_;
  PassContext context_;
};

}  // namespace acmp
