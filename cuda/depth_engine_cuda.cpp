#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>

#include "acmp_mapping/backend/depth_engine_cuda.h"
#include "cuda_depth_engine.h"

namespace acmp {

EngineImagePtr CudaDepthEngine::LoadLevels(const Frame& frame, int levels) {
  auto image = std::make_shared<CudaImage>();
  image->device = runner_.device().get();
  PinholeCamera camera = frame.camera;
  for (int level = 0; level <= levels; ++level, camera = camera.Halved()) {
    image->levels.push_back(
        std::make_unique<ImageLayer>(runner_.device(), level, camera.width, camera.height, stream()));
  }
  const std::shared_lock<std::shared_mutex> images(device().images_mutex());
  device().images(0).Upload(frame.gray.View(), image->Layer(0), &staging_, stream());
  for (int level = 1; level <= levels; ++level) {
    device().images(level).QueueHalf(device().images(level - 1), image->Layer(level - 1), image->Layer(level),
                                     stream());
  }
  stream().Synchronize();
  return image;
}

PassData CudaDepthEngine::MakePassData(const EngineProblem& problem, int level, const CudaEstimate& estimate) const {
  PassData data;
  data.level = level;
  data.reference_layer = Cast<CudaImage>(problem.reference.image).Layer(level);
  for (const EngineView& source : problem.sources) {
    data.source_layers.push_back(Cast<CudaImage>(source.image).Layer(level));
  }
  data.planes = estimate.planes.data();
  data.cost = estimate.cost.data();
  static_assert(sizeof(uint32_t) == sizeof(float), "a pixel's selected views take the place of its depth");
  data.selected_views = reinterpret_cast<uint32_t*>(estimate.depth.data());
  return data;
}

ImageView<uint32_t> CudaDepthEngine::NumbersIn(CudaEstimate* estimate) {
  static_assert(sizeof(uint32_t) == sizeof(float), "a triangle's number takes the place of a depth");
  return {reinterpret_cast<uint32_t*>(estimate->depth.data()), estimate->width, estimate->height, estimate->width};
}

void CudaDepthEngine::CheckSourceSizes(const EngineProblem& problem, int level) const {
  for (const EngineView& source : problem.sources) {
    if (!source.estimate) continue;
    const CudaEstimate& estimate = Cast<CudaEstimate>(source.estimate);
    CheckSize("estimate of a source view", estimate.width, estimate.height, CameraAtLevel(source.frame->camera, level));
  }
}

void CudaDepthEngine::AddSourceDepths(const EngineProblem& problem, PassData* data) {
  for (const EngineView& source : problem.sources) {
    data->source_depths.push_back(source.estimate ? HalvedDepthOf(Cast<CudaEstimate>(source.estimate)) : HalvedDepth());
  }
}

void CudaDepthEngine::AddFullDepths(const EngineProblem& problem, PassData* data) const {
  for (const EngineView& source : problem.sources) {
    data->full_depths.push_back(source.estimate ? Cast<CudaEstimate>(source.estimate).DepthView()
                                                : ImageView<const float>());
  }
}

HalvedDepth CudaDepthEngine::HalvedDepthOf(const CudaEstimate& estimate) {
  const int width = HalvedSize(estimate.width), height = HalvedSize(estimate.height);
  const std::lock_guard<std::mutex> lock(estimate.halved_mutex);
  if (estimate.inverse_depth.size() == 0) {
    begin_.Record(stream());
    DeviceArray<uint16_t> halved = QueueHalvedDepth(estimate);
    FinishTiming();
    KeepHalvedDepth(std::move(halved), estimate);
  }
  return {{estimate.inverse_depth.data(), width, height, width}, estimate.inverse_step};
}

DeviceArray<uint16_t> CudaDepthEngine::QueueHalvedDepth(const CudaEstimate& estimate) {
  const int width = HalvedSize(estimate.width), height = HalvedSize(estimate.height);
  DeviceArray<uint16_t> halved(runner_.device(), static_cast<size_t>(width) * height);
  largest_inverse_.Reserve(runner_.device(), 1);
  LaunchHalveDepth(estimate.DepthView(), largest_inverse_.data(), {halved.data(), width, height, width},
                   stream().get());
  largest_inverse_.Download(largest_inverse_on_host_.Reserve<float>(1), 1, stream());
  return halved;
}

void CudaDepthEngine::KeepHalvedDepth(DeviceArray<uint16_t> halved, const CudaEstimate& estimate) {
  estimate.inverse_depth = std::move(halved);
  estimate.inverse_step = *largest_inverse_on_host_.Reserve<float>(1) / kInverseSteps;
}

void CudaDepthEngine::UploadPrior(const PriorMesh& mesh) {
  const size_t count = mesh.triangles.size();
  triangles_.Reserve(runner_.device(), count);
  prior_planes_.Reserve(runner_.device(), count);
  if (count == 0) return;
  auto* planes =
      staging_.Reserve<PlaneHypothesis>(count + count * sizeof(TriangleCorners) / sizeof(PlaneHypothesis) + 1);
  auto* corners = reinterpret_cast<TriangleCorners*>(planes + count);
  tbb::parallel_for(size_t{0}, count, [&](size_t i) {
    planes[i] = mesh.planes[i];
    for (int k = 0; k < 3; ++k) {
      const SupportPoint& point = mesh.points[static_cast<size_t>(mesh.triangles[i].vertex[k])];
      corners[i].col[k] = point.col;
      corners[i].row[k] = point.row;
    }
  });
  prior_planes_.Upload(planes, count, stream());
  triangles_.Upload(corners, count, stream());
}

void CudaDepthEngine::QueuePrior(const PatchMatchProblem& match, int triangles, const ImageView<uint32_t>& numbers) {
  LaunchRasterizePrior({triangles_.data(), prior_planes_.data(), triangles}, MakeRayGrid(match.reference.camera),
                       match.depth_range.min, match.depth_range.max, numbers, stream().get());
}

void CudaDepthEngine::QueueDepths(const PinholeCamera& camera, CudaEstimate* estimate) {
  LaunchToDepth(estimate->PlaneView(), MakeRayGrid(camera), estimate->depth.data(), stream().get());
}

void CudaDepthEngine::FinishSource(const PinholeCamera& camera, CudaEstimate* estimate) {
  QueueDepths(camera, estimate);
  DeviceArray<uint16_t> halved = QueueHalvedDepth(*estimate);
  FinishTiming();
  KeepHalvedDepth(std::move(halved), *estimate);
}

void CudaDepthEngine::FinishTiming() {
  end_.Record(stream());
  stream().Synchronize();
  device_ms_ += CudaEvent::ElapsedMs(begin_, end_);
}

std::vector<SupportPoint> CudaDepthEngine::FindCells(const CudaEstimate& maps, const DepthRange& range,
                                                     const PlanarPriorOptions& options) {
  const int size = options.cell_size_px;
  const size_t count =
      static_cast<size_t>((maps.width + size - 1) / size) * static_cast<size_t>((maps.height + size - 1) / size);
  cells_.Reserve(runner_.device(), count);
  LaunchFindSupport({maps.DepthView(), maps.CostView(), range.min, range.max, options.max_support_cost, size},
                    cells_.data(), stream().get());
  SupportPoint* staged = staging_.Reserve<SupportPoint>(count);
  cells_.Download(staged, count, stream());
  stream().Synchronize();
  std::vector<SupportPoint> points;
  points.reserve(count);
  std::copy_if(staged, staged + count, std::back_inserter(points),
               [](const SupportPoint& point) { return point.depth > 0; });
  return points;
}

std::shared_ptr<CudaEstimate> CudaDepthEngine::UseUp(const EngineEstimatePtr& start) {
  if (!IsUnique(start)) return nullptr;
  // It was not made const, and nobody is left to see it.
  return std::const_pointer_cast<CudaEstimate>(std::static_pointer_cast<const CudaEstimate>(start));
}

void CudaDepthEngine::QueueCopy(const CudaEstimate& from, CudaEstimate* to) const {
  to->planes.CopyFrom(from.planes, from.Pixels(), stream());
  to->cost.CopyFrom(from.cost, from.Pixels(), stream());
}

std::shared_ptr<CudaEstimate> CudaDepthEngine::Continue(const EngineEstimatePtr& start) const {
  std::shared_ptr<CudaEstimate> used_up = UseUp(start);
  if (!used_up) {
    const CudaEstimate& from = Cast<CudaEstimate>(start);
    auto copy = std::make_shared<CudaEstimate>(runner_.device(), from.width, from.height);
    QueueCopy(from, copy.get());
    return copy;
  }
  used_up->inverse_depth = DeviceArray<uint16_t>();
  return used_up;
}

template <Pass kPass>
EngineEstimatePtr CudaDepthEngine::RunPass(const EngineProblem& problem, const PatchMatchOptions& options, int level,
                                           const EngineEstimatePtr& start, const PriorMesh* prior, int geometric_pass,
                                           int iterations) {
  Validate(options);
  const PatchMatchProblem match = MakePatchMatchProblem(problem, level);
  const PinholeCamera& camera = match.reference.camera;
  if (kPass != Pass::kPhotometric) {
    const CudaEstimate& from = Cast<CudaEstimate>(start);
    CheckSize("start", from.width, from.height, camera);
  }
  if (kPass == Pass::kGeometric) CheckSourceSizes(problem, level);
  return OnDevice([&] {
    const size_t pixels = static_cast<size_t>(camera.width) * camera.height;
    DeviceArray<uint32_t> selected_views;  // only where the prior's numbers have the place of the depths
    if (prior != nullptr) {
      UploadPrior(*prior);
      selected_views = DeviceArray<uint32_t>(runner_.device(), pixels);
    }
    const std::shared_ptr<CudaEstimate> estimate =
        kPass == Pass::kPhotometric ? std::make_shared<CudaEstimate>(runner_.device(), camera) : Continue(start);
    const std::unique_lock<std::mutex> turn = device().PassTurn(pixels);
    PassData data = MakePassData(problem, level, *estimate);
    const bool is_ours = options.method == Method::kOurs;
    if (kPass == Pass::kGeometric && is_ours) AddSourceDepths(problem, &data);
    if (kPass == Pass::kGeometric && !is_ours) AddFullDepths(problem, &data);
    const int triangles = prior != nullptr ? static_cast<int>(prior->triangles.size()) : 0;
    const ImageView<uint32_t> numbers = NumbersIn(estimate.get());
    if (prior != nullptr) {
      data.selected_views = selected_views.data();
      data.prior = {{prior_planes_.data(), triangles, 1, triangles}, numbers};
    }
    const std::shared_lock<std::shared_mutex> images(device().images_mutex());
    const CudaMatchContext context = runner_.Prepare(match, options, data, kPass, geometric_pass);
    begin_.Record(stream());
    if (prior != nullptr) QueuePrior(match, triangles, numbers);
    runner_.Queue<kPass>(context, iterations);
    if (kPass == Pass::kGeometric && is_ours) {
      FinishSource(camera, estimate.get());
    } else {
      QueueDepths(camera, estimate.get());
      FinishTiming();
    }
    return EngineEstimatePtr(estimate);
  });
}

std::unique_ptr<DepthEngine> CudaDepthEngine::Share() {
  device().MakeCurrent();
  return std::make_unique<CudaDepthEngine>(runner_.device());
}

EngineImagePtr CudaDepthEngine::Load(const FramePtr& frame, int levels) {
  CheckLoad(frame, levels);
  return OnDevice([&] { return LoadLevels(*frame, levels); });
}

EngineEstimatePtr CudaDepthEngine::RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                                  int level) {
  return RunPass<Pass::kPhotometric>(problem, options, level, nullptr, nullptr, 0, options.photometric_iterations);
}

EngineEstimatePtr CudaDepthEngine::RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                                  EngineEstimatePtr start, const PriorMesh& prior) {
  return RunPass<Pass::kPlanarPrior>(problem, options, 0, start, &prior, 0, options.planar_prior_iterations);
}

EngineEstimatePtr CudaDepthEngine::RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                                EngineEstimatePtr start, int pass) {
  const CudaEstimate& from = Cast<CudaEstimate>(start);
  const int level = LevelOf(problem, from.width, from.height);
  return RunPass<Pass::kGeometric>(problem, options, level, start, nullptr, pass, options.geometric_iterations);
}

EngineEstimatePtr CudaDepthEngine::RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                                  EngineEstimatePtr start, const EngineEstimatePtr& coarser) {
  Validate(options);
  const CudaEstimate& from = Cast<CudaEstimate>(start);
  const int level = LevelOf(problem, from.width, from.height);
  const PatchMatchProblem match = MakePatchMatchProblem(problem, level);
  const PinholeCamera& camera = match.reference.camera;
  const PinholeCamera halved = camera.Halved();
  const CudaEstimate& halved_estimate = Cast<CudaEstimate>(coarser);
  CheckSize("coarser estimate", halved_estimate.width, halved_estimate.height, halved);
  return OnDevice([&] {
    const std::shared_ptr<CudaEstimate> estimate = Continue(start);
    const std::unique_lock<std::mutex> turn = device().PassTurn(estimate->Pixels());
    const PassData data = MakePassData(problem, level, *estimate);
    const std::shared_lock<std::shared_mutex> images(device().images_mutex());
    const CudaMatchContext context = runner_.Prepare(match, options, data, Pass::kPhotometric, 0);
    begin_.Record(stream());
    runner_.QueueRestoreDetails(context, {halved_estimate.PlaneView(), MakeRayGrid(halved)});
    QueueDepths(camera, estimate.get());
    FinishTiming();
    return EngineEstimatePtr(estimate);
  });
}

EngineEstimatePtr CudaDepthEngine::Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) {
  const CudaEstimate& halved = Cast<CudaEstimate>(estimate);
  CheckUpsample(frame, level, halved.width, halved.height);
  return OnDevice([&] {
    auto full = std::make_shared<CudaEstimate>(runner_.device(), frame->camera);
    const ImageView<PlaneHypothesis> planes = {full->planes.data(), full->width, full->height, full->width};
    begin_.Record(stream());
    LaunchUpsample({halved.PlaneView(), halved.cost.data(), MakeRayGrid(CameraAtLevel(frame->camera, level)), level},
                   MakeRayGrid(frame->camera), planes, full->cost.data(), stream().get());
    QueueDepths(frame->camera, full.get());
    FinishTiming();
    return full;
  });
}

std::vector<SupportPoint> CudaDepthEngine::FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                                             const PlanarPriorOptions& options) {
  Validate(options);
  CheckDepthRange("depth range of the support points", range);
  const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
  return OnDevice([&] { return FindCells(maps, range, options); });
}

size_t CudaDepthEngine::FreeDeviceBytes() const {
  device().MakeCurrent();
  size_t free = 0, total = 0;
  CudaCheck(cudaMemGetInfo(&free, &total), "read free memory");
  return free;
}

std::string CudaDepthEngine::device_name() const {
  return Concat(runner_.device()->properties().name, " (cuda:", runner_.device()->index(), ")");
}

std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int cuda_index) {
  return std::make_unique<CudaDepthEngine>(std::make_shared<CudaDevice>(cuda_index));
}

}  // namespace acmp
