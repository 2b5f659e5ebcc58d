#include <tbb/blocked_range.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include "acmp_mapping/backend/depth_engine_cuda.h"
#include "acmp_mapping/common/error.h"
#include "completion_runner.h"
#include "fusion_runner.h"
#include "map_kernels.h"
#include "pass_runner.h"
#include "staged_copy.h"

namespace acmp {
namespace {

struct CudaImage final : EngineImage {
  const CudaDevice* device = nullptr;
  std::vector<std::unique_ptr<ImageLayer>> levels;
  mutable std::mutex color_mutex;
  mutable DeviceArray<Rgb> color;  ///< copied when it is first asked for: matching does without

  int Layer(int level) const {
    if (level >= static_cast<int>(levels.size())) {
      throw InvalidInputError(Concat("level = ", level, ": the image was loaded with ", levels.size() - 1));
    }
    return levels[static_cast<size_t>(level)]->layer();
  }
};

struct CudaEstimate final : EngineEstimate {
  CudaEstimate(const CudaDevicePtr& device, const PinholeCamera& camera)
      : CudaEstimate(device, camera.width, camera.height) {}
  CudaEstimate(const CudaDevicePtr& device, int width, int height)
      : device(device.get()),
        width(width),
        height(height),
        planes(device, Pixels()),
        cost(device, Pixels()),
        depth(device, Pixels()) {}

  size_t Pixels() const { return static_cast<size_t>(width) * height; }
  ImageView<const PlaneHypothesis> PlaneView() const { return {planes.data(), width, height, width}; }
  ImageView<const float> CostView() const { return {cost.data(), width, height, width}; }
  ImageView<const float> DepthView() const { return {depth.data(), width, height, width}; }

  const CudaDevice* device;
  int width, height;
  DeviceArray<PlaneHypothesis> planes;
  DeviceArray<float> cost, depth;
};

struct CudaStamps final : FusionStamps {
  const CudaDevice* device = nullptr;
  std::map<int64_t, DeviceArray<Stamp>> by_frame;
  Stamp next = 0;
};

void CheckSize(const char* name, int width, int height, const PinholeCamera& camera) {
  if (width == camera.width && height == camera.height) return;
  throw InvalidInputError(
      Concat(name, ": ", width, " x ", height, " px, but the camera has ", camera.width, " x ", camera.height));
}

void CheckFrame(const EngineView& view) {
  if (!view.frame) throw InvalidInputError("frame: must not be null");
}

class CudaDepthEngine final : public DepthEngine {
 public:
  explicit CudaDepthEngine(const CudaDevicePtr& device) : runner_(device), completion_(device), fusion_(device) {}

  std::unique_ptr<DepthEngine> Share() override {
    device().MakeCurrent();
    return std::make_unique<CudaDepthEngine>(runner_.device());
  }

  EngineImagePtr Load(const FramePtr& frame, int levels) override {
    if (!frame) throw InvalidInputError("frame: must not be null");
    CheckRange("levels", levels, 0, kMaxLevels);
    CheckCamera("camera of the smallest level", CameraAtLevel(frame->camera, levels));
    return OnDevice([&] { return LoadLevels(*frame, levels); });
  }

  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override {
    return RunPass<Pass::kPhotometric>(problem, options, level, nullptr, nullptr, 0, options.photometric_iterations);
  }

  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   const EngineEstimatePtr& start, const PriorMesh& prior) override {
    return RunPass<Pass::kPlanarPrior>(problem, options, 0, &Cast<CudaEstimate>(start), &prior, 0,
                                       options.planar_prior_iterations);
  }

  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 const EngineEstimatePtr& start, int pass) override {
    return RunPass<Pass::kGeometric>(problem, options, 0, &Cast<CudaEstimate>(start), nullptr, pass,
                                     options.geometric_iterations);
  }

  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override {
    if (!frame) throw InvalidInputError("frame: must not be null");
    CheckRange("level", level, 0, kMaxLevels);
    const CudaEstimate& halved = Cast<CudaEstimate>(estimate);
    CheckSize("halved estimate", halved.width, halved.height, CameraAtLevel(frame->camera, level));
    return OnDevice([&] {
      auto full = std::make_shared<CudaEstimate>(runner_.device(), frame->camera);
      const ImageView<PlaneHypothesis> planes = {full->planes.data(), full->width, full->height, full->width};
      LaunchUpsample({halved.PlaneView(), halved.cost.data(), MakeRayGrid(CameraAtLevel(frame->camera, level)), level},
                     MakeRayGrid(frame->camera), planes, full->cost.data(), stream().get());
      FinishEstimate(frame->camera, *full);
      return full;
    });
  }

  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override {
    Validate(options);
    CheckDepthRange("depth range of the support points", range);
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] { return FindCells(maps, range, options); });
  }

  EngineEstimatePtr Complete(const EngineProblem& problem, const CompletionOptions& options) override;
  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override;
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options) override;
  std::unique_ptr<FusionStamps> MakeFusionStamps() override {
    auto stamps = std::make_unique<CudaStamps>();
    stamps->device = runner_.device().get();
    return stamps;
  }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      FusionStamps* stamps) override;

  EstimateMaps Download(const EngineEstimatePtr& estimate) override;
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override;
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override;
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate) override;
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override;

  double TakeDeviceMs() override { return std::exchange(device_ms_, 0.0); }
  size_t DeviceBytes() const override { return runner_.device()->Bytes(); }
  size_t FreeDeviceBytes() const override {
    device().MakeCurrent();
    size_t free = 0, total = 0;
    CudaCheck(cudaMemGetInfo(&free, &total), "read free memory");
    return free;
  }
  std::string device_name() const override {
    return Concat(runner_.device()->properties().name, " (cuda:", runner_.device()->index(), ")");
  }

 private:
  CudaDevice& device() const { return *runner_.device(); }
  const CudaStream& stream() const { return runner_.stream(); }

  template <class Handle, class Base>
  const Handle& Cast(const std::shared_ptr<const Base>& handle) const {
    const auto* cast = dynamic_cast<const Handle*>(handle.get());
    if (cast == nullptr || cast->device != runner_.device().get()) {
      throw InvalidInputError("a handle is null or belongs to another device");
    }
    return *cast;
  }

  /// Runs `work` with the device selected for this thread; after a failure nothing is left under way.
  template <class Work>
  auto OnDevice(const Work& work) -> decltype(work()) {
    device().MakeCurrent();
    try {
      return work();
    } catch (...) {
      cudaStreamSynchronize(stream().get());  // queued work must not outlive the memory it uses
      cudaGetLastError();
      throw;
    }
  }

  EngineImagePtr LoadLevels(const Frame& frame, int levels) {
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

  PatchMatchProblem MakeProblem(const EngineProblem& problem, int level) const {
    CheckHandles(problem, level);
    PatchMatchProblem match = MakePatchMatchProblem(problem);
    Check(match);
    match.reference.camera = CameraAtLevel(match.reference.camera, level);
    for (MatchView& source : match.sources) source.camera = CameraAtLevel(source.camera, level);
    return match;
  }

  template <Pass kPass>
  EngineEstimatePtr RunPass(const EngineProblem& problem, const PatchMatchOptions& options, int level,
                            const CudaEstimate* start, const PriorMesh* prior, int geometric_pass, int iterations) {
    Validate(options);
    const PatchMatchProblem match = MakeProblem(problem, level);
    const PinholeCamera& camera = match.reference.camera;
    if (start != nullptr) CheckSize("start", start->width, start->height, camera);
    return OnDevice([&] {
      auto estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
      PassData data = MakePassData(problem, level, *estimate);
      if (kPass == Pass::kGeometric) AddSourceDepths(problem, &data);
      if (prior != nullptr) UploadPrior(*prior);
      const std::unique_lock<std::mutex> turn = device().PassTurn(estimate->Pixels());
      begin_.Record(stream());
      if (start != nullptr) {
        estimate->planes.CopyFrom(start->planes, estimate->Pixels(), stream());
        estimate->cost.CopyFrom(start->cost, estimate->Pixels(), stream());
      }
      if (prior != nullptr) data.prior = QueuePrior(match, static_cast<int>(prior->triangles.size()));
      const std::shared_lock<std::shared_mutex> images(device().images_mutex());
      runner_.Queue<kPass>(match, options, data, geometric_pass, iterations);
      FinishEstimate(camera, *estimate);
      device_ms_ += CudaEvent::ElapsedMs(begin_, end_);
      return estimate;
    });
  }

  PassData MakePassData(const EngineProblem& problem, int level, const CudaEstimate& estimate) const {
    PassData data;
    data.level = level;
    data.reference_layer = Cast<CudaImage>(problem.reference.image).Layer(level);
    for (const EngineView& source : problem.sources) {
      data.source_layers.push_back(Cast<CudaImage>(source.image).Layer(level));
    }
    data.planes = estimate.planes.data();
    data.cost = estimate.cost.data();
    return data;
  }

  void AddSourceDepths(const EngineProblem& problem, PassData* data) const {
    for (const EngineView& source : problem.sources) {
      data->source_depths.push_back(source.estimate ? Cast<CudaEstimate>(source.estimate).DepthView()
                                                    : ImageView<const float>());
    }
  }

  void UploadPrior(const PriorMesh& mesh) {
    const size_t count = mesh.triangles.size();
    triangles_.Reserve(runner_.device(), count);
    PriorTriangle* staged = staging_.Reserve<PriorTriangle>(count);
    tbb::parallel_for(size_t{0}, count, [&](size_t i) {
      staged[i].plane = mesh.planes[i];
      for (int k = 0; k < 3; ++k) {
        const SupportPoint& point = mesh.points[static_cast<size_t>(mesh.triangles[i].vertex[k])];
        staged[i].corners.col[k] = point.col;
        staged[i].corners.row[k] = point.row;
      }
    });
    if (count > 0) triangles_.Upload(staged, count, stream());
  }

  /// Draws the uploaded triangles.
  const PlaneHypothesis* QueuePrior(const PatchMatchProblem& match, int triangles) {
    const PinholeCamera& camera = match.reference.camera;
    prior_.Reserve(runner_.device(), static_cast<size_t>(camera.width) * camera.height);
    LaunchRasterizePrior(triangles_.data(), triangles, MakeRayGrid(camera), match.depth_range.min,
                         match.depth_range.max, {prior_.data(), camera.width, camera.height, camera.width},
                         stream().get());
    return prior_.data();
  }

  /// The estimate's depths, and the wait for all that was queued.
  void FinishEstimate(const PinholeCamera& camera, const CudaEstimate& estimate) {
    LaunchToDepth(estimate.PlaneView(), MakeRayGrid(camera), estimate.depth.data(), stream().get());
    end_.Record(stream());
    stream().Synchronize();
  }

  std::vector<SupportPoint> FindCells(const CudaEstimate& maps, const DepthRange& range,
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

  static PosedCamera PosedCameraOf(const EngineView& view) {
    CheckFrame(view);
    return {view.frame->camera, view.frame->cam_from_world};
  }
  DeviceFusionView GeometryMapsOf(const EngineView& view);
  DeviceFusionView FusionMapsOf(const EngineView& view);
  ImageView<const Rgb> ColorOf(const EngineView& view);
  ImageView<Stamp> StampsOf(const Frame& frame, CudaStamps* stamps);

  PassRunner runner_;
  CompletionRunner completion_;
  FusionRunner fusion_;
  CudaEvent begin_, end_;
  PinnedBuffer staging_;
  StagedDownload download_;
  DeviceArray<PlaneHypothesis> prior_;
  DeviceArray<PriorTriangle> triangles_;
  DeviceArray<SupportPoint> cells_;
  double device_ms_ = 0;
};

EstimateMaps CudaDepthEngine::Download(const EngineEstimatePtr& estimate) {
  const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
  return OnDevice([&] {
    const size_t pixels = maps.Pixels();
    EstimateMaps result = {DepthMap(maps.width, maps.height), NormalMap(maps.width, maps.height),
                           CostMap(maps.width, maps.height)};
    download_.Run(maps.depth, pixels, stream(), result.depth.data());
    download_.Run(maps.cost, pixels, stream(), result.cost.data());
    download_.Run(maps.planes, pixels, stream(), [&](size_t begin, const PlaneHypothesis* planes, size_t size) {
      Vec3f* normals = result.normal.data() + begin;
      tbb::parallel_for(tbb::blocked_range<size_t>(0, size, 1 << 15), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) normals[i] = planes[i].normal();
      });
    });
    return result;
  });
}

EstimateState CudaDepthEngine::DownloadState(const EngineEstimatePtr& estimate) {
  const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
  return OnDevice([&] {
    EstimateState state = {PlaneMap(maps.width, maps.height), CostMap(maps.width, maps.height)};
    download_.Run(maps.planes, maps.Pixels(), stream(), state.planes.data());
    download_.Run(maps.cost, maps.Pixels(), stream(), state.cost.data());
    return state;
  });
}

EngineEstimatePtr CudaDepthEngine::UploadState(EstimateState state, const PinholeCamera& camera) {
  CheckSize("plane map", state.planes.width(), state.planes.height(), camera);
  CheckSize("cost map", state.cost.width(), state.cost.height(), camera);
  return OnDevice([&] {
    auto estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
    const size_t pixels = estimate->Pixels();
    estimate->planes.Upload(state.planes.data(), pixels, stream());
    estimate->cost.Upload(state.cost.data(), pixels, stream());
    FinishEstimate(camera, *estimate);
    return estimate;
  });
}

EngineEstimatePtr CudaDepthEngine::Import(const EngineEstimatePtr& estimate) {
  const auto* from = dynamic_cast<const CudaEstimate*>(estimate.get());
  if (from == nullptr) throw InvalidInputError("a handle is null or not of a GPU");
  if (from->device == runner_.device().get()) return estimate;
  return OnDevice([&] {
    auto copy = std::make_shared<CudaEstimate>(runner_.device(), from->width, from->height);
    copy->planes.CopyFromPeer(from->planes, copy->Pixels(), stream());
    copy->cost.CopyFromPeer(from->cost, copy->Pixels(), stream());
    copy->depth.CopyFromPeer(from->depth, copy->Pixels(), stream());
    stream().Synchronize();
    return copy;
  });
}

EngineEstimatePtr CudaDepthEngine::UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) {
  CheckSize("depth map", maps.depth.width, maps.depth.height, camera);
  CheckSize("normal map", maps.normal.width, maps.normal.height, camera);
  CheckSize("cost map", maps.cost.width, maps.cost.height, camera);
  return OnDevice([&] {
    auto estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
    const size_t pixels = estimate->Pixels();
    auto* planes = staging_.Reserve<PlaneHypothesis>(pixels + pixels / 2 + 1);
    auto* depth = reinterpret_cast<float*>(planes + pixels);
    float* cost = depth + pixels;
    const RayGrid rays = MakeRayGrid(camera);
    tbb::parallel_for(0, camera.height, [&](int row) {
      const size_t begin = static_cast<size_t>(row) * camera.width;
      std::copy_n(&maps.depth(0, row), camera.width, depth + begin);
      std::copy_n(&maps.cost(0, row), camera.width, cost + begin);
      for (int col = 0; col < camera.width; ++col) {
        const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
        planes[begin + col] = PlaneThrough(maps.normal(col, row), ray, maps.depth(col, row));
      }
    });
    estimate->planes.Upload(planes, pixels, stream());
    estimate->depth.Upload(depth, pixels, stream());
    estimate->cost.Upload(cost, pixels, stream());
    stream().Synchronize();
    return estimate;
  });
}

/// Without colours.
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

EngineEstimatePtr CudaDepthEngine::Complete(const EngineProblem& problem, const CompletionOptions& options) {
  Validate(options);
  CheckDepthRange("depth range of the completion", problem.depth_range);
  const CudaEstimate& start = Cast<CudaEstimate>(problem.reference.estimate);
  return OnDevice([&] {
    FusionSetup<DeviceFusionView> setup(PosedCameraOf(problem.reference), GeometryMapsOf(problem.reference),
                                        ConfirmationLimits(options), RigidTransform::Identity());
    for (const EngineView& source : problem.sources) {
      if (source.estimate) setup.AddSource(PosedCameraOf(source), GeometryMapsOf(source));
    }
    if (setup.sources().empty()) return problem.reference.estimate;
    const PinholeCamera& camera = problem.reference.frame->camera;
    auto estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
    begin_.Record(stream());
    estimate->planes.CopyFrom(start.planes, estimate->Pixels(), stream());
    estimate->cost.CopyFrom(start.cost, estimate->Pixels(), stream());
    const int num_sources = static_cast<int>(setup.sources().size());
    completion_.Queue(setup, MakeCompletionContext(camera, problem.depth_range, options, num_sources),
                      {estimate->planes.data(), camera.width, camera.height, camera.width}, estimate->cost.data(),
                      stream());
    FinishEstimate(camera, *estimate);
    device_ms_ += CudaEvent::ElapsedMs(begin_, end_);
    return EngineEstimatePtr(estimate);
  });
}

ConsistencyResult CudaDepthEngine::FilterByConsistency(const EngineView& reference,
                                                       const std::vector<EngineView>& sources,
                                                       const FusionOptions& options) {
  return OnDevice([&] {
    FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), FusionMapsOf(reference), MakeFusionLimits(options),
                                        RigidTransform::Identity());
    for (const EngineView& source : sources) {
      if (source.estimate) setup.AddSource(PosedCameraOf(source), FusionMapsOf(source));
    }
    return fusion_.Filter(setup, stream());
  });
}

ConfidenceMap CudaDepthEngine::MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                                 const FusionOptions& options) {
  return OnDevice([&] {
    FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), GeometryMapsOf(reference), MakeFusionLimits(options),
                                        RigidTransform::Identity());
    for (const EngineView& source : sources) {
      if (source.estimate) setup.AddSource(PosedCameraOf(source), GeometryMapsOf(source));
    }
    return fusion_.MeasureConfidence(setup, stream());
  });
}

ImageView<Stamp> CudaDepthEngine::StampsOf(const Frame& frame, CudaStamps* stamps) {
  const int width = frame.camera.width, height = frame.camera.height;
  auto found = stamps->by_frame.find(frame.id);
  if (found == stamps->by_frame.end()) {
    static_assert(kUnusedStamp == 0xffff, "both bytes are set to 0xff");
    DeviceArray<Stamp> unused(runner_.device(), static_cast<size_t>(width) * height);
    CudaCheck(cudaMemsetAsync(unused.data(), 0xff, unused.size() * sizeof(Stamp), stream().get()), "reset stamps");
    found = stamps->by_frame.emplace(frame.id, std::move(unused)).first;
  }
  return {found->second.data(), width, height, width};
}

PointCloud CudaDepthEngine::FuseView(const EngineView& reference, const std::vector<EngineView>& sources,
                                     const FusionOptions& options, FusionStamps* stamps) {
  auto* device_stamps = dynamic_cast<CudaStamps*>(stamps);
  if (device_stamps == nullptr || device_stamps->device != runner_.device().get()) {
    throw InvalidInputError("stamps: null or of another device");
  }
  CheckRange("number of fused views", device_stamps->next + 1, 1, kMaxFusionViews);
  return OnDevice([&] {
    FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), FusionMapsOf(reference), MakeFusionLimits(options),
                                        reference.frame->cam_from_world.inverse());
    setup.SetStamps(StampsOf(*reference.frame, device_stamps), device_stamps->next++);
    for (const EngineView& source : sources) {
      if (!source.estimate) continue;
      setup.AddSource(PosedCameraOf(source), FusionMapsOf(source), StampsOf(*source.frame, device_stamps));
    }
    return fusion_.Fuse(setup, reference.frame->camera.width, reference.frame->camera.height, stream());
  });
}

}  // namespace

std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int cuda_index) {
  return std::make_unique<CudaDepthEngine>(std::make_shared<CudaDevice>(cuda_index));
}

}  // namespace acmp
