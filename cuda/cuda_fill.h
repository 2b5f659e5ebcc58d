#pragma once

#include <memory>
#include <shared_mutex>
#include <utility>

#include "acmp_mapping/fill/fill.h"
#include "cuda_fusion.h"
#include "cuda_passes.h"
#include "fill_kernels.h"

namespace acmp {

/// The filling of what the passes leave unverified and the free-space check on the GPU.
class CudaFill : public virtual DepthEngine {
 public:
  /// Both outlive this.
  CudaFill(DeviceQueue* queue, HalvedDepths* halved) : queue_(*queue), halved_(*halved), context_(queue, halved) {}

  EngineEstimatePtr FillUnverified(const EngineProblem& problem, EngineEstimatePtr start,
                                   const FillOptions& options) override {
    const size_t pixels = queue_.Cast<CudaEstimate>(start).Pixels();
    return queue_.OnDevice([&] {
      EngineView reference = problem.reference;
      reference.estimate = start;
      const FusionSetup setup = SetUpFusion(reference, problem.sources, ConsistencyLimits(),
                                            [&](const EngineView& view) { return DeviceMapsOf(view, queue_); });
      const FillContext context =
          MakeFillContext(setup.camera(), problem.depth_range, options, static_cast<int>(setup.sources().size()));
      if (setup.sources().empty()) return start;
      reference.estimate.reset();  // for Continue; the setup's look at its maps is queued before they are filled
      const PinholeCamera& camera = problem.reference.frame->camera;
      DeviceArray<PlaneHypothesis> planes;  // of the filter; afterwards those of before
      ImageView<const Rgb> color;
      if (options.weighted_median) {
        planes = DeviceArray<PlaneHypothesis>(queue_.device(), pixels);
        color = ColorOf(problem.reference, &queue_);
      }
      const std::shared_ptr<CudaEstimate> estimate = Continue(start, queue_);
      queue_.StartClock();
      QueueFill(setup, context, estimate.get());
      if (options.weighted_median) QueueMedian(setup, context, color, estimate.get(), &planes);
      halved_.Finish(camera, estimate.get());
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override {
    const PatchMatchProblem match = MakePatchMatchProblem(problem, 0);
    const PinholeCamera& camera = match.reference.camera;
    const CudaEstimate& from = queue_.Cast<CudaEstimate>(start);
    CheckSize("start", from.width, from.height, camera);
    return queue_.OnDevice([&] {
      std::shared_ptr<CudaEstimate> estimate = UseUp(start);
      if (!estimate) {
        estimate = std::make_shared<CudaEstimate>(queue_.device(), camera);
        queue_.StartClock();
        QueueCopy(from, estimate.get(), queue_.stream());
        estimate->depth.CopyFrom(from.depth, from.Pixels(), queue_.stream());  // planes stay, so do their depths
        queue_.FinishClock();
      }
      const std::shared_lock<std::shared_mutex> images(queue_.device()->images_mutex());
      CudaMatchContext context = context_.Prepare(problem, match, 0, {}, Pass::kGeometric, 0, estimate.get());
      context.selected_views = {};  // none are written: the depths keep their memory
      FillContext textured = MakeTexturedContext(camera, estimate->PlaneView(), estimate->CostView());
      const int cols = CellsOf(camera.width, textured.cell_size), rows = CellsOf(camera.height, textured.cell_size);
      const size_t cells = static_cast<size_t>(cols) * rows;
      evidence_.Reserve(queue_.device(), cells);
      cells_.Reserve(queue_.device(), cells);
      nearest_.Reserve(queue_.device(), cells);
      const ImageView<float> evidence = {evidence_.data(), cols, rows, cols};
      textured.fitted = {cells_.data(), cols, rows, cols};
      textured.nearest = {nearest_.data(), cols, rows, cols};
      queue_.StartClock();
      LaunchMeasureEvidence(context, textured.cell_size, evidence, queue_.stream().get());
      LaunchFreeSpaceCheck(textured, evidence, queue_.stream().get());
      queue_.FinishClock();
      return EngineEstimatePtr(estimate);
    });
  }

 private:
  /// Queues FillUnverified without the median.
  /// @param sources the reference's maps as they were before, and its source views
  /// @param context from MakeFillContext
  /// @param estimate a copy of the reference's, changed
  void QueueFill(const FusionSetup& sources, FillContext context, CudaEstimate* estimate) {
    const CudaDevicePtr& device = queue_.device();
    const int width = estimate->width, height = estimate->height;
    const int cell_cols = CellsOf(width, context.cell_size), cell_rows = CellsOf(height, context.cell_size);
    const size_t cells = static_cast<size_t>(cell_cols) * cell_rows;
    sources_.Reserve(device, sources.sources().size());
    sources_.Upload(sources.sources().data(), sources.sources().size(), queue_.stream());
    support_.Reserve(device, estimate->Pixels());
    cells_.Reserve(device, 2 * cells);
    nearest_.Reserve(device, cells);
    const ImageView<ViewSupport> support = {support_.data(), width, height, width};
    context.support = support;
    context.planes = estimate->PlaneView();
    context.cost = estimate->CostView();
    context.seeds = {cells_.data(), cell_cols, cell_rows, cell_cols};
    context.fitted = {cells_.data() + cells, cell_cols, cell_rows, cell_cols};
    context.nearest = {nearest_.data(), cell_cols, cell_rows, cell_cols};
    LaunchLook(sources.Context(sources_.data()), support, queue_.stream().get());
    LaunchFill(context, queue_.stream().get());
  }
  /// Queues the weighted median of what QueueFill left.
  /// @param sources,context as they were given to it
  /// @param planes of the estimate's size; become those of before, which the stream still reads
  void QueueMedian(const FusionSetup& sources, const FillContext& context, const ImageView<const Rgb>& color,
                   CudaEstimate* estimate, DeviceArray<PlaneHypothesis>* planes) {
    const int width = estimate->width, height = estimate->height;
    LaunchToDepth(std::as_const(*estimate).PlaneView(), context.rays, estimate->depth.data(), queue_.stream().get());
    FusionContext views = sources.Context(sources_.data());
    views.reference = {estimate->DepthView(), estimate->PlaneView(), estimate->CostView(), color};
    const ImageView<ViewSupport> support = {support_.data(), width, height, width};
    MedianContext median = {};
    median.rays = context.rays;
    median.depth_min = context.depth_min;
    median.depth_max = context.depth_max;
    median.planes = estimate->PlaneView();
    median.depth = estimate->DepthView();
    median.support = support;
    median.color = color;
    median.filtered = {planes->data(), width, height, width};
    median.cost = estimate->CostView();
    LaunchWeightedMedian(views, support, median, queue_.stream().get());
    std::swap(*planes, estimate->planes);
  }

  DeviceQueue& queue_;
  HalvedDepths& halved_;
  PassContext context_;
  DeviceArray<FusionSource> sources_;
  DeviceArray<ViewSupport> support_;
  DeviceArray<SeedCell> cells_;
  DeviceArray<NearestSeeds> nearest_;
  DeviceArray<float> evidence_;
};

}  // namespace acmp
