#include "acmp_mapping/backend/make_depth_engine.h"
#include "cuda_passes.h"

namespace acmp {
namespace {

/// The engine of one GPU, on a stream of its own: what the other parts do not have, filling and fusion. Engines that
/// Share() made have the device in common. Buffers are for one call at a time, and only grow.
class CudaDepthEngine final : public CudaPasses {
 public:
  using CudaPasses::CudaPasses;

  std::unique_ptr<DepthEngine> Share() override {
    device_->MakeCurrent();
    return std::make_unique<CudaDepthEngine>(device_);
  }
  EngineEstimatePtr FillUnverified(const EngineProblem& problem, EngineEstimatePtr start,
                                   const FillOptions& options) override {
    Cast<CudaEstimate>(start);
    return OnDevice([&] {
      EngineView reference = problem.reference;
      reference.estimate = start;
      const FusionSetup setup = SetUpFusion(reference, problem.sources, ConsistencyLimits(),
                                            [this](const EngineView& view) { return MapsOf(view, false); });
      const FillContext context =
          MakeFillContext(setup.camera(), problem.depth_range, options, static_cast<int>(setup.sources().size()));
      if (setup.sources().empty()) return start;
      reference.estimate.reset();  // for Continue; the setup's look at its maps is queued before they are filled
      const PinholeCamera& camera = problem.reference.frame->camera;
      ImageView<const Rgb> color;
      if (options.weighted_median) color = ColorOf(problem.reference);
      const std::shared_ptr<CudaEstimate> estimate = Continue(start);
      StartClock();
      QueueFill(setup, context, estimate.get());
      if (options.weighted_median) QueueMedian(setup, context, color, estimate.get());
      QueueDepths(camera, estimate.get());
      FinishHalved(*estimate);
      return EngineEstimatePtr(estimate);
    });
  }
  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override {
    return CheckConsistency(reference, sources, options, true);
  }
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options) override {
    return CheckConsistency(reference, sources, options, false).confidence;
  }
  std::unique_ptr<FusionStamps> MakeFusionStamps() override { return std::make_unique<CudaStamps>(); }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    CudaStamps& gpu_stamps = CastStamps(stamps);
    const auto stamps_of = [&](const Frame& frame) { return gpu_stamps.Of(frame, device_, stream_).View(); };
    return OnDevice([&] {
      const FusionSetup setup = SetUpFusion(
          reference, sources, MakeFusionLimits(options), [this](const EngineView& view) { return MapsOf(view, true); },
          stamps_of, StampOfRank(rank));
      const FusionContext context = QueueOdds(setup);
      return points_.Run(device_, PixelsOf(setup), stream_, [&](const PixelRange& range, const PointOutput& output) {
        LaunchFuseView(context, range, output, stream_.get());
      });
    });
  }

 private:
  static CudaStamps& CastStamps(FusionStamps* stamps) {
    auto* gpu_stamps = dynamic_cast<CudaStamps*>(stamps);
    if (gpu_stamps == nullptr) throw InvalidInputError("stamps: null or not of a GPU");
    return *gpu_stamps;
  }
  static size_t PixelsOf(const FusionSetup& setup) {
    return static_cast<size_t>(setup.camera().width) * setup.camera().height;
  }
  /// Queues FillUnverified without the median.
  /// @param setup the reference's maps as they were before, and its source views
  /// @param context from MakeFillContext
  /// @param estimate a copy of the reference's, changed
  void QueueFill(const FusionSetup& setup, FillContext context, CudaEstimate* estimate) {
    const int cols = CellsOf(estimate->width, context.cell_size), rows = CellsOf(estimate->height, context.cell_size);
    const ImageView<ViewSupport> support = support_.Reserve(device_, estimate->width, estimate->height);
    context.support = support;
    context.planes = estimate->planes.View();
    context.cost = estimate->cost.View();
    context.seeds = seeds_.Reserve(device_, cols, rows);
    context.fitted = fitted_.Reserve(device_, cols, rows);
    context.nearest = nearest_.Reserve(device_, cols, rows);
    LaunchLook(QueueSources(setup), support, stream_.get());
    LaunchFill(context, stream_.get());
  }
  /// Queues the weighted median of what QueueFill left.
  /// @param setup,context as they were given to it
  void QueueMedian(const FusionSetup& setup, const FillContext& context, const ImageView<const Rgb>& color,
                   CudaEstimate* estimate) {
    // The estimate gets this memory in place of its own: it must not be larger.
    if (filtered_.pixels.size() != estimate->Pixels()) {
      filtered_ = {};
      filtered_ = DeviceMap<PlaneHypothesis>(device_, estimate->width, estimate->height);
    }
    filtered_.Reserve(device_, estimate->width, estimate->height);
    LaunchToDepth(estimate->planes.View(), context.rays, estimate->depth.View(), stream_.get());
    FusionContext views = setup.Context(sources_.data());
    views.reference = {estimate->depth.View(), estimate->planes.View(), estimate->cost.View(), color};
    const ImageView<ViewSupport> support = support_.View();
    LaunchWeightedMedian(views, support,
                         {context.rays, context.depth_min, context.depth_max, estimate->planes.View(),
                          estimate->depth.View(), support, color, filtered_.View(), estimate->cost.View()},
                         stream_.get());
    std::swap(filtered_, estimate->planes);  // the stream still reads those of before
  }

  /// Throws InvalidInputError without an estimate of this GPU.
  FusionMaps MapsOf(const EngineView& view, bool with_color) {
    const CudaEstimate& maps = Cast<CudaEstimate>(view.estimate);
    FusionMaps result = {maps.depth.View(), maps.planes.View(), maps.cost.View(), {}};
    if (with_color) result.color = ColorOf(view);
    return result;
  }
  /// The setup's context, with its sources queued.
  FusionContext QueueSources(const FusionSetup& setup) { return setup.Context(Uploaded(setup.sources(), &sources_)); }
  /// The same with the odds of its depths queued.
  FusionContext QueueOdds(const FusionSetup& setup) {
    const FusionContext context = QueueSources(setup);
    log_odds_.Reserve(device_, PixelsOf(setup));
    return LaunchOdds(context, log_odds_.data(), stream_.get());
  }
  /// @param with_points else the confidences alone
  ConsistencyResult CheckConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                     const FusionOptions& options, bool with_points) {
    return OnDevice([&] {
      const FusionSetup setup = SetUpFusion(reference, sources, MakeFusionLimits(options),
                                            [this](const EngineView& view) { return MapsOf(view, true); });
      const int width = setup.camera().width, height = setup.camera().height;
      const FusionContext context = QueueOdds(setup);
      const ImageView<float> confidence = confidence_.Reserve(device_, width, height);
      const auto launch = [&](const PixelRange& range, const PointOutput& output) {
        LaunchFilterByConsistency(context, range, confidence, output, stream_.get());
      };
      ConsistencyResult result;
      if (with_points) {
        result.points_in_camera = points_.Run(device_, PixelsOf(setup), stream_, launch);
      } else {
        launch({0, PixelsOf(setup)}, {});
      }
      result.confidence = Fetch(confidence_);
      return result;
    });
  }

  PointDownload points_;
  DeviceArray<FusionSource> sources_;
  DeviceMap<ViewSupport> support_;
  DeviceMap<SeedCell> seeds_;
  DeviceMap<PlaneHypothesis> filtered_;  ///< by the weighted median; between its calls, planes of before the last one
  DeviceMap<float> confidence_;
  DeviceArray<float> log_odds_;
};

}  // namespace

std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int cuda_index) {
  return std::make_unique<CudaDepthEngine>(std::make_shared<CudaDevice>(cuda_index));
}

}  // namespace acmp
