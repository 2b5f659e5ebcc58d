// CudaDepthEngine: what compares the maps of several views.

#include "cuda_depth_engine.h"

namespace acmp {
namespace {

void CheckFrame(const EngineView& view) {
  if (!view.frame) throw InvalidInputError("frame: must not be null");
}

}  // namespace

PosedCamera CudaDepthEngine::PosedCameraOf(const EngineView& view) {
  CheckFrame(view);
  return {view.frame->camera, view.frame->cam_from_world};
}

DeviceFusionView CudaDepthEngine::GeometryMapsOf(const EngineView& view) {
  CheckFrame(view);
  const CudaEstimate& estimate = Cast<CudaEstimate>(view.estimate);
  CheckSize("estimate", estimate.width, estimate.height, view.frame->camera);
  return {estimate.DepthView(), estimate.PlaneView(), estimate.CostView(), {}};
}

DeviceFusionView CudaDepthEngine::FusionMapsOf(const EngineView& view) {
  DeviceFusionView maps = GeometryMapsOf(view);
  maps.color = ColorOf(view);
  return maps;
}

ImageView<const Rgb> CudaDepthEngine::ColorOf(const EngineView& view) {
  const ColorImage& color = view.frame->color;
  if (color.empty()) return {};
  const CudaImage& image = Cast<CudaImage>(view.image);
  const std::lock_guard<std::mutex> lock(image.color_mutex);
  if (image.color.size() == 0) {
    DeviceArray<Rgb> copy(runner_.device(), color.size());
    Rgb* staged = staging_.Reserve<Rgb>(color.size());
    ParallelCopy(color.data(), color.size(), staged);
    copy.Upload(staged, color.size(), stream());
    stream().Synchronize();
    image.color = std::move(copy);
  }
  return {image.color.data(), color.width(), color.height(), color.width()};
}

FusionSetup<DeviceFusionView> CudaDepthEngine::SetUp(const EngineView& reference,
                                                     const std::vector<EngineView>& sources, const FusionLimits& limits,
                                                     DeviceFusionView (CudaDepthEngine::*maps_of)(const EngineView&)) {
  FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), (this->*maps_of)(reference), limits,
                                      RigidTransform::Identity());
  for (const EngineView& source : sources) {
    if (source.estimate) setup.AddSource(PosedCameraOf(source), (this->*maps_of)(source));
  }
  return setup;
}

void CudaDepthEngine::FilterByMedian(const FusionSetup<DeviceFusionView>& setup, const FillContext& context,
                                     const ImageView<const Rgb>& color, CudaEstimate* estimate,
                                     DeviceArray<PlaneHypothesis>* planes) {
  LaunchToDepth(estimate->PlaneView(), context.rays, estimate->depth.data(), stream().get());
  fill_.QueueMedian(setup, {estimate->DepthView(), estimate->PlaneView(), estimate->CostView(), color}, context,
                    estimate->cost.data(), planes->data(), stream());
  std::swap(*planes, estimate->planes);
}

CudaDepthEngine::EvidenceSearch CudaDepthEngine::PrepareEvidence(const EngineProblem& problem, CudaEstimate* estimate) {
  const PatchMatchProblem match = MakePatchMatchProblem(problem, 0);
  const PinholeCamera& camera = match.reference.camera;
  PassData data = MakePassData(problem, 0, *estimate);
  data.selected_views = nullptr;  // none are written: the depths keep their memory
  AddSourceDepths(problem, &data);
  const FillContext textured =
      MakeTexturedContext(camera, {estimate->planes.data(), camera.width, camera.height, camera.width},
                          {estimate->cost.data(), camera.width, camera.height, camera.width});
  const int cell_cols = CellsOf(camera.width, textured.cell_size);
  const int cell_rows = CellsOf(camera.height, textured.cell_size);
  float* evidence = fill_.ReserveEvidence(static_cast<size_t>(cell_cols) * cell_rows);
  return {runner_.Prepare(match, {}, data, Pass::kGeometric, 0), textured, {evidence, cell_cols, cell_rows, cell_cols}};
}

void CudaDepthEngine::QueueEvidence(const EvidenceSearch& search) {
  runner_.QueueEvidence(search.match, search.textured.cell_size, search.evidence);
}

EngineEstimatePtr CudaDepthEngine::FillUnverified(const EngineProblem& problem, const FillOptions& options) {
  CheckDepthRange("depth range of the completion", problem.depth_range);
  const CudaEstimate& start = Cast<CudaEstimate>(problem.reference.estimate);
  return OnDevice([&] {
    const FusionSetup<DeviceFusionView> setup =
        SetUp(problem.reference, problem.sources, ConsistencyLimits(), &CudaDepthEngine::GeometryMapsOf);
    if (setup.sources().empty()) return problem.reference.estimate;
    const PinholeCamera& camera = problem.reference.frame->camera;
    DeviceArray<PlaneHypothesis> planes;  // of the filter; afterwards those of before
    ImageView<const Rgb> color;
    if (options.weighted_median) {
      planes = DeviceArray<PlaneHypothesis>(runner_.device(), start.Pixels());
      color = ColorOf(problem.reference);
    }
    const FillContext context =
        MakeFillContext(camera, problem.depth_range, options, static_cast<int>(setup.sources().size()));
    const auto estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
    begin_.Record(stream());
    QueueCopy(start, estimate.get());
    fill_.Queue(setup, context, {estimate->planes.data(), camera.width, camera.height, camera.width},
                estimate->cost.data(), stream());
    if (options.weighted_median) FilterByMedian(setup, context, color, estimate.get(), &planes);
    FinishSource(camera, estimate.get());
    return EngineEstimatePtr(estimate);
  });
}

EngineEstimatePtr CudaDepthEngine::RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) {
  CheckHandles(problem, 0);
  const PinholeCamera& camera = problem.reference.frame->camera;
  const CudaEstimate& from = Cast<CudaEstimate>(start);
  CheckSize("start", from.width, from.height, camera);
  return OnDevice([&] {
    std::shared_ptr<CudaEstimate> estimate = UseUp(start);
    if (!estimate) {
      estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
      begin_.Record(stream());
      QueueCopy(from, estimate.get());
      estimate->depth.CopyFrom(from.depth, from.Pixels(), stream());  // planes stay, so do their depths
      FinishTiming();
    }
    const std::shared_lock<std::shared_mutex> images(device().images_mutex());
    const EvidenceSearch search = PrepareEvidence(problem, estimate.get());
    begin_.Record(stream());
    QueueEvidence(search);
    fill_.QueueFreeSpaceCheck(search.textured, stream());
    FinishTiming();
    return EngineEstimatePtr(estimate);
  });
}

ConsistencyResult CudaDepthEngine::FilterByConsistency(const EngineView& reference,
                                                       const std::vector<EngineView>& sources,
                                                       const FusionOptions& options) {
  return OnDevice([&] {
    return fusion_.Filter(SetUp(reference, sources, MakeFusionLimits(options), &CudaDepthEngine::FusionMapsOf),
                          stream());
  });
}

ConfidenceMap CudaDepthEngine::MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                                 const FusionOptions& options) {
  return OnDevice([&] {
    return fusion_.MeasureConfidence(
        SetUp(reference, sources, MakeFusionLimits(options), &CudaDepthEngine::FusionMapsOf), stream());
  });
}

DeviceArray<Stamp> CudaDepthEngine::UnusedStamps(size_t pixels) {
  static_assert(kUnusedStamp == 0xffff, "both bytes are set to 0xff");
  DeviceArray<Stamp> stamps(runner_.device(), pixels);
  CudaCheck(cudaMemsetAsync(stamps.data(), 0xff, pixels * sizeof(Stamp), stream().get()), "reset stamps");
  return stamps;
}

void CudaDepthEngine::MoveHere(DeviceArray<Stamp>* stamps) {
  {
    DeviceArray<Stamp> moved(runner_.device(), stamps->size());
    moved.CopyFromPeer(*stamps, stamps->size(), stream());
    stream().Synchronize();  // before the other GPU gets its memory back
    *stamps = std::move(moved);
  }
  device().MakeCurrent();  // freeing selected the other GPU
}

ImageView<Stamp> CudaDepthEngine::StampsOf(const Frame& frame, CudaStamps* stamps) {
  const int width = frame.camera.width, height = frame.camera.height;
  DeviceArray<Stamp>& of_frame = stamps->Of(frame.id);
  if (of_frame.size() == 0) {
    of_frame = UnusedStamps(static_cast<size_t>(width) * height);
  } else if (of_frame.device() != runner_.device()) {
    MoveHere(&of_frame);
  }
  return {of_frame.data(), width, height, width};
}

PointCloud CudaDepthEngine::FuseView(const EngineView& reference, const std::vector<EngineView>& sources,
                                     const FusionOptions& options, int rank, FusionStamps* stamps) {
  auto* gpu_stamps = dynamic_cast<CudaStamps*>(stamps);
  if (gpu_stamps == nullptr) throw InvalidInputError("stamps: null or not of a GPU");
  const Stamp stamp = StampOfRank(rank);
  return OnDevice([&] {
    FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), FusionMapsOf(reference), MakeFusionLimits(options),
                                        reference.frame->cam_from_world.inverse());
    setup.SetStamps(StampsOf(*reference.frame, gpu_stamps), stamp);
    for (const EngineView& source : sources) {
      if (!source.estimate) continue;
      setup.AddSource(PosedCameraOf(source), FusionMapsOf(source), StampsOf(*source.frame, gpu_stamps));
    }
    return fusion_.Fuse(setup, reference.frame->camera.width, reference.frame->camera.height, stream());
  });
}

std::unique_ptr<FusionStamps> CudaDepthEngine::MakeFusionStamps() { return std::make_unique<CudaStamps>(); }

}  // namespace acmp
