#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/fill/fill.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "acmp_mapping/planar_prior/kernel/support_grid.h"
#include "cuda_handles.h"
#include "kernels.h"
#include "staged_copy.h"

namespace acmp {
namespace {

/// The engine of one GPU, on a stream of its own. Engines that Share() made have the device in common. Buffers are for
/// one call at a time, and only grow.
class CudaDepthEngine final : public DepthEngine {
 public:
  explicit CudaDepthEngine(CudaDevicePtr device) : device_(std::move(device)) {}

  std::unique_ptr<DepthEngine> Share() override {
    device_->MakeCurrent();
    return std::make_unique<CudaDepthEngine>(device_);
  }
  size_t DeviceBytes() const override { return device_->Bytes(); }
  size_t FreeDeviceBytes() const override {
    device_->MakeCurrent();
    size_t free = 0, total = 0;
    CudaCheck(cudaMemGetInfo(&free, &total), "read free memory");
    return free;
  }
  std::string device_name() const override {
    return Concat(device_->properties().name, " (cuda:", device_->index(), ")");
  }
  double PopDeviceTime() override { return std::exchange(counted_ms_, 0.0); }

  EngineImagePtr Load(const FramePtr& frame, int levels) override {
    CheckLoad(frame, levels);
    return OnDevice([&] {
      auto image = std::make_shared<CudaImage>(device_);
      PinholeCamera camera = frame->camera;
      for (int level = 0; level <= levels; ++level, camera = camera.Halved()) {
        image->layers.push_back(
            device_->images(level).Acquire(camera.width, camera.height, stream_, &device_->images_mutex()));
      }
      const std::shared_lock<FairSharedMutex> images(device_->images_mutex());
      device_->images(0).Upload(frame->gray.View(), image->Layer(0), &staging_, stream_);
      for (int level = 1; level <= levels; ++level) {
        device_->images(level).QueueHalf(device_->images(level - 1), image->Layer(level - 1), image->Layer(level),
                                         stream_);
      }
      stream_.Synchronize();
      if (frame->mask.empty()) return EngineImagePtr(image);
      for (const MaskDistanceMap& of_level : MakeMaskDistances(*frame, levels)) {
        image->mask_distances.push_back(CopyToDevice(of_level));
      }
      return EngineImagePtr(image);
    });
  }
  EstimateMaps Download(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] {
      EstimateMaps result;
      std::vector<StagedDownload::Block> blocks;
      AddFetch(maps.depth, &result.depth, &blocks);
      StagedDownload::AddBlocks(
          maps.planes.pixels, maps.Pixels(),
          [&](size_t begin, const PlaneHypothesis* planes, size_t size) {
            if (begin == 0) result.normal = NormalMap(maps.width, maps.height);
            Vec3f* normals = result.normal.data() + begin;
            tbb::parallel_for(tbb::blocked_range<size_t>(0, size, 1 << 15),
                              [&](const tbb::blocked_range<size_t>& range) {
                                for (size_t i = range.begin(); i < range.end(); ++i) normals[i] = planes[i].normal();
                              });
          },
          &blocks);
      AddFetch(maps.cost, &result.cost, &blocks);
      download_.Run(blocks, stream_);
      return result;
    });
  }
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] { return Fetch(maps.depth); });
  }
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] { return EstimateState{Fetch(maps.planes), Fetch(maps.cost)}; });
  }
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override {
    CheckUpload(state, camera);
    return OnDevice([&] {
      const std::shared_ptr<CudaEstimate> estimate = NewEstimate(camera);
      estimate->planes.pixels.Upload(state.planes.data(), estimate->Pixels(), stream_);
      estimate->cost.pixels.Upload(state.cost.data(), estimate->Pixels(), stream_);
      QueueDepths(camera, estimate.get());
      stream_.Synchronize();
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override {
    const PlaneMap planes = MakePlanes(maps, camera);
    const DepthMap depth = Clone(maps.depth);
    const CostMap cost = Clone(maps.cost);
    return OnDevice([&] {
      const std::shared_ptr<CudaEstimate> estimate = NewEstimate(camera);
      estimate->planes.pixels.Upload(planes.data(), planes.size(), stream_);
      estimate->depth.pixels.Upload(depth.data(), depth.size(), stream_);
      estimate->cost.pixels.Upload(cost.data(), cost.size(), stream_);
      stream_.Synchronize();
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate) override {
    const auto* from = dynamic_cast<const CudaEstimate*>(estimate.get());
    if (from == nullptr) throw InvalidInputError("a handle is null or not of a GPU");
    if (from->device == device_) return estimate;
    return OnDevice([&] {
      auto copy = std::make_shared<CudaEstimate>(device_, from->width, from->height);
      copy->planes.pixels.CopyFromPeer(from->planes.pixels, copy->Pixels(), stream_);
      copy->cost.pixels.CopyFromPeer(from->cost.pixels, copy->Pixels(), stream_);
      copy->depth.pixels.CopyFromPeer(from->depth.pixels, copy->Pixels(), stream_);
      stream_.Synchronize();
      return EngineEstimatePtr(copy);
    });
  }

  // The steps that compare images.

  EngineEstimatePtr RunPass(const EngineProblem& problem, const PatchMatchOptions& options, EnginePass pass) override {
    const int level = pass.kind == Pass::kGeometric ? LevelOfEstimate(problem, pass.start) : pass.level;
    const PatchMatchProblem match = MakePatchMatchProblem(problem, level);
    const PinholeCamera& camera = match.reference.camera;
    if (pass.kind != Pass::kPhotometric) CheckStartSize(pass.start, camera);
    return OnDevice([&] {
      const size_t pixels = static_cast<size_t>(camera.width) * camera.height;
      const std::shared_ptr<CudaEstimate> estimate =
          pass.kind == Pass::kPhotometric ? NewEstimate(camera) : Continue(pass.start);
      const std::unique_lock<std::mutex> turn = device_->PassTurn(pixels);
      const std::shared_lock<FairSharedMutex> images(device_->images_mutex());
      CudaMatchContext context =
          MakeContext(problem, match, level, options, pass.kind, pass.geometric_pass, estimate.get());
      StartClock();
      if (pass.kind == Pass::kPlanarPrior) {
        selected_views_.Reserve(device_, pixels);
        context.selected_views.data = selected_views_.data();
        context.prior = QueuePrior(pass, camera, match.depth_range, estimate->NumbersView());
      }
      VisitPass(pass.kind, options.method, [&](auto kind, auto method) {
        LaunchPass<kind, method>(context, IterationsOf(kind, options), stream_.get());
      });
      QueueDepths(camera, estimate.get());
      if (pass.kind == Pass::kGeometric && options.method == Method::kOurs) {
        FinishHalved(*estimate);
      } else {
        FinishClock();
      }
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override {
    const CudaEstimate& halved = Cast<CudaEstimate>(estimate);
    CheckUpsample(frame, level, halved.width, halved.height);
    return OnDevice([&] {
      const std::shared_ptr<CudaEstimate> full = NewEstimate(frame->camera);
      StartClock();
      LaunchUpsample(
          {halved.planes.View(), halved.cost.View(), MakeRayGrid(CameraAtLevel(frame->camera, level)), level},
          MakeRayGrid(frame->camera), full->planes.View(), full->cost.View(), stream_.get());
      QueueDepths(frame->camera, full.get());
      FinishClock();
      return EngineEstimatePtr(full);
    });
  }
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override {
    const int level = LevelOfEstimate(problem, start);
    const PatchMatchProblem match = MakePatchMatchProblem(problem, level);
    const PinholeCamera& camera = match.reference.camera;
    const PinholeCamera halved = camera.Halved();
    const CudaEstimate& halved_estimate = Cast<CudaEstimate>(coarser);
    CheckSize("coarser estimate", halved_estimate.width, halved_estimate.height, halved);
    return OnDevice([&] {
      const std::shared_ptr<CudaEstimate> estimate = Continue(start);
      const std::unique_lock<std::mutex> turn = device_->PassTurn(estimate->Pixels());
      const std::shared_lock<FairSharedMutex> images(device_->images_mutex());
      const CudaMatchContext context =
          MakeContext(problem, match, level, options, Pass::kPhotometric, 0, estimate.get());
      StartClock();
      LaunchRestoreDetails(context, {halved_estimate.planes.View(), MakeRayGrid(halved)}, stream_.get());
      QueueDepths(camera, estimate.get());
      FinishClock();
      return EngineEstimatePtr(estimate);
    });
  }
  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override {
    CheckDepthRange("depth range of the support points", range);
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] {
      const int size = options.cell_size_px;
      const ImageView<SupportPoint> cells =
          support_points_.Reserve(device_, CellsOf(maps.width, size), CellsOf(maps.height, size));
      const size_t count = static_cast<size_t>(cells.width) * cells.height;
      LaunchFindSupport({maps.depth.View(), maps.cost.View(), range.min, range.max, options.max_support_cost, size},
                        cells, stream_.get());
      SupportPoint* staged = staging_.Reserve<SupportPoint>(count);
      support_points_.pixels.Download(staged, count, stream_);
      stream_.Synchronize();
      std::vector<SupportPoint> points;
      points.reserve(count);
      std::copy_if(staged, staged + count, std::back_inserter(points),
                   [](const SupportPoint& point) { return point.depth > 0; });
      return points;
    });
  }
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override {
    const PatchMatchProblem match = MakePatchMatchProblem(problem, 0);
    const PinholeCamera& camera = match.reference.camera;
    CheckStartSize(start, camera);
    return OnDevice([&] {
      const std::shared_ptr<CudaEstimate> estimate = Continue(start);
      const std::shared_lock<FairSharedMutex> images(device_->images_mutex());
      const CudaMatchContext context = MakeContext(problem, match, 0, {}, Pass::kGeometric, 0, estimate.get());
      FillContext textured = MakeTexturedContext(camera, estimate->planes.View(), estimate->cost.View());
      const int cols = CellsOf(camera.width, textured.cell_size), rows = CellsOf(camera.height, textured.cell_size);
      const ImageView<float> evidence = evidence_.Reserve(device_, cols, rows);
      textured.fitted = fitted_.Reserve(device_, cols, rows);
      textured.nearest = nearest_.Reserve(device_, cols, rows);
      StartClock();
      LaunchMeasureEvidence(context, textured.cell_size, evidence, stream_.get());
      LaunchFreeSpaceCheck(textured, evidence, stream_.get());
      QueueDepths(camera, estimate.get());
      FinishClock();
      return EngineEstimatePtr(estimate);
    });
  }

  // Filling and fusion.

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
  /// Throws InvalidInputError for null and for what belongs to another device.
  template <class Handle, class Base>
  const Handle& Cast(const std::shared_ptr<const Base>& handle) const {
    const auto* cast = dynamic_cast<const Handle*>(handle.get());
    if (cast == nullptr || cast->device != device_) {
      throw InvalidInputError("a handle is null or belongs to another device");
    }
    return *cast;
  }
  /// Runs `work` with the device selected for this thread; after a failure nothing is left under way.
  template <class Work>
  auto OnDevice(const Work& work) -> decltype(work()) {
    device_->MakeCurrent();
    try {
      return work();
    } catch (...) {
      cudaStreamSynchronize(stream_.get());  // queued work must not outlive the memory it uses
      cudaGetLastError();
      throw;
    }
  }
  void StartClock() { begin_.Record(stream_); }
  /// Waits for all that was queued and counts the device's time since StartClock.
  void FinishClock() {
    end_.Record(stream_);
    stream_.Synchronize();
    counted_ms_ += CudaEvent::ElapsedMs(begin_, end_);
  }

  /// Adds the copy of a map to host memory.
  /// @param fetched allocated with the first block, while the next one is copied
  template <class T>
  static void AddFetch(const DeviceMap<T>& map, Image<T>* fetched, std::vector<StagedDownload::Block>* blocks) {
    const int width = map.width, height = map.height;
    StagedDownload::AddBlocks(
        map.pixels, static_cast<size_t>(width) * height,
        [=](size_t begin, const T* block, size_t size) {
          if (begin == 0) *fetched = Image<T>(width, height);
          ParallelCopy(block, size, fetched->data() + begin);
        },
        blocks);
  }
  /// The map in host memory.
  template <class T>
  Image<T> Fetch(const DeviceMap<T>& map) {
    Image<T> fetched;
    std::vector<StagedDownload::Block> blocks;
    AddFetch(map, &fetched, &blocks);
    download_.Run(blocks, stream_);
    return fetched;
  }
  /// The map on the device; waits for the copy.
  template <class T>
  DeviceMap<T> CopyToDevice(const Image<T>& map) {
    DeviceMap<T> copy(device_, map.width(), map.height());
    T* staged = staging_.Reserve<T>(map.size());
    ParallelCopy(map.data(), map.size(), staged);
    copy.pixels.Upload(staged, map.size(), stream_);
    stream_.Synchronize();
    return copy;
  }
  /// The view's colours; empty where the frame has none.
  ImageView<const Rgb> ColorOf(const EngineView& view) {
    if (view.frame->color.empty()) return {};
    const CudaImage& image = Cast<CudaImage>(view.image);
    const std::lock_guard<std::mutex> lock(image.color_mutex);
    if (image.color.width == 0) image.color = CopyToDevice(view.frame->color);
    return std::as_const(image.color).View();
  }

  std::shared_ptr<CudaEstimate> NewEstimate(const PinholeCamera& camera) const {
    return std::make_shared<CudaEstimate>(device_, camera.width, camera.height);
  }
  /// An estimate with the start's planes and costs: itself if nobody else holds it, else a copy that is queued.
  std::shared_ptr<CudaEstimate> Continue(const EngineEstimatePtr& start) const {
    const CudaEstimate& from = Cast<CudaEstimate>(start);
    if (IsUnique(start)) {
      // It was not made const, and nobody is left to see it.
      auto used_up = std::const_pointer_cast<CudaEstimate>(std::static_pointer_cast<const CudaEstimate>(start));
      used_up->inverse_depth = {};
      return used_up;
    }
    auto copy = std::make_shared<CudaEstimate>(device_, from.width, from.height);
    copy->planes.pixels.CopyFrom(from.planes.pixels, from.Pixels(), stream_);
    copy->cost.pixels.CopyFrom(from.cost.pixels, from.Pixels(), stream_);
    return copy;
  }
  /// Queues the depths of the estimate's planes.
  void QueueDepths(const PinholeCamera& camera, CudaEstimate* estimate) const {
    LaunchToDepth(estimate->planes.View(), MakeRayGrid(camera), estimate->depth.View(), stream_.get());
  }

  /// Queues the upload of all elements, which stay as they are until the stream has been waited for, into `array`,
  /// which grows as needed; on the device.
  template <class T>
  const T* Uploaded(const std::vector<T>& elements, DeviceArray<T>* array) const {
    array->Reserve(device_, elements.size());
    if (!elements.empty()) array->Upload(elements.data(), elements.size(), stream_);
    return array->data();
  }
  /// Halves the depths, waits for all that was queued and stops the clock.
  void FinishHalved(const CudaEstimate& estimate) {
    DeviceMap<uint16_t> halved(device_, HalvedSize(estimate.width), HalvedSize(estimate.height));
    largest_inverse_.Reserve(device_, 1);
    LaunchHalveDepth(estimate.depth.View(), largest_inverse_.data(), halved.View(), stream_.get());
    float* largest_inverse = staging_.Reserve<float>(1);
    largest_inverse_.Download(largest_inverse, 1, stream_);
    FinishClock();
    estimate.inverse_depth = std::move(halved);
    estimate.inverse_step = *largest_inverse / kInverseSteps;
  }
  int LevelOfEstimate(const EngineProblem& problem, const EngineEstimatePtr& estimate) const {
    const CudaEstimate& of_size = Cast<CudaEstimate>(estimate);
    return LevelOf(problem, of_size.width, of_size.height);
  }
  void CheckStartSize(const EngineEstimatePtr& start, const PinholeCamera& camera) const {
    const CudaEstimate& from = Cast<CudaEstimate>(start);
    CheckSize("start", from.width, from.height, camera);
  }
  /// The halved depths that geometric passes of other views read. The estimate keeps them: made now if they have not
  /// been.
  HalvedDepth HalvedOf(const CudaEstimate& estimate) {
    const std::lock_guard<std::mutex> lock(estimate.halved_mutex);
    if (estimate.inverse_depth.width == 0) {
      StartClock();
      FinishHalved(estimate);
    }
    return {std::as_const(estimate.inverse_depth).View(), estimate.inverse_step};
  }

  /// Queues the planar prior of a pass.
  /// @param numbers of the pixels' planes; may take the place of the start's depths
  PriorMap QueuePrior(const EnginePass& pass, const PinholeCamera& camera, const DepthRange& range,
                      const ImageView<uint32_t>& numbers) {
    const RayGrid rays = MakeRayGrid(camera);
    if (pass.grid_prior != nullptr) {
      const CudaEstimate& start = Cast<CudaEstimate>(pass.start);
      const int size = pass.grid_prior->cell_size_px;
      const int cols = CellsOf(camera.width, size), rows = CellsOf(camera.height, size);
      triangles_.Reserve(device_, 2 * static_cast<size_t>(cols) * rows);
      planes_.Reserve(device_, 2 * static_cast<size_t>(cols) * rows);
      const SupportGrid grid = {size, support_points_.Reserve(device_, cols, rows),
                                flooded_points_.Reserve(device_, cols, rows), triangles_.data(), planes_.data()};
      LaunchFindSupport(
          {start.depth.View(), start.cost.View(), range.min, range.max, pass.grid_prior->max_support_cost, size},
          grid.points, stream_.get());
      LaunchGridPrior(grid, rays, static_cast<float>(MinPriorCosine(*pass.grid_prior)), range, numbers, stream_.get());
    } else {
      const PriorMesh none;
      const PriorMesh& mesh = pass.prior == nullptr ? none : *pass.prior;
      Uploaded(mesh.triangles, &triangles_);
      Uploaded(mesh.planes, &planes_);
      LaunchRasterizePrior({triangles_.data(), planes_.data(), static_cast<int>(mesh.triangles.size())}, rays,
                           range.min, range.max, numbers, stream_.get());
    }
    return {planes_.data(), numbers};
  }

  /// The context of a pass over an estimate, until the next call: geometric passes read the sources' depths, the views
  /// that pixels select take the place of the estimate's depths, and there is no prior. Queues the upload of what it
  /// points to: whoever then starts the clock does not count the host's work. The caller holds images_mutex() shared
  /// from here until the stream has been waited for. Throws InvalidInputError unless the sources' estimates are of the
  /// level.
  /// @param match MakePatchMatchProblem of the problem at that level
  CudaMatchContext MakeContext(const EngineProblem& problem, const PatchMatchProblem& match, int level,
                               const PatchMatchOptions& options, Pass kind, int geometric_pass,
                               CudaEstimate* estimate) {
    const size_t count = problem.sources.size();
    host_views_ = MakeSourceViews(match);
    host_full_depths_.assign(count, {});
    host_mask_distances_.assign(count, {});
    CudaMatchContext context = MakeMatchContext<TextureSampler>(match, options, kind, geometric_pass);
    const CudaImage& reference = Cast<CudaImage>(problem.reference.image);
    context.sampler.images = device_->images(level).texture();
    context.sampler.reference = reference.Layer(level);
    bool has_masks = false;
    for (size_t i = 0; i < count; ++i) {
      const EngineView& source = problem.sources[i];
      const CudaImage& image = Cast<CudaImage>(source.image);
      context.sampler.layers[i] = image.Layer(level);
      host_mask_distances_[i] = image.MaskDistance(level);
      has_masks |= !host_mask_distances_[i].empty();
      if (kind != Pass::kGeometric || !source.estimate) continue;
      const CudaEstimate& maps = Cast<CudaEstimate>(source.estimate);
      CheckSize("estimate of a source view", maps.width, maps.height, match.sources[i].camera);
      if (options.method == Method::kOurs) {
        host_views_[i].depth = HalvedOf(maps);
      } else {
        host_full_depths_[i] = maps.depth.View();
      }
    }
    context.sources = Uploaded(host_views_, &views_);
    context.full_depths = Uploaded(host_full_depths_, &full_depths_);
    context.source_mask_distances = has_masks ? Uploaded(host_mask_distances_, &mask_distances_) : nullptr;
    context.mask_distance = reference.MaskDistance(level);
    context.planes = estimate->planes.View();
    context.cost = estimate->cost.View();
    context.selected_views = estimate->NumbersView();
    return context;
  }

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

  const CudaDevicePtr device_;
  const CudaStream stream_;
  PinnedBuffer staging_;  ///< for one copy at a time, which is waited for before the next use
  StagedDownload download_;
  CudaEvent begin_, end_;
  double counted_ms_ = 0;

  // Of the last context. The first three, as the stream may read them until it has been waited for.
  std::vector<SourceView> host_views_;
  std::vector<ImageView<const float>> host_full_depths_;
  std::vector<ImageView<const unsigned char>> host_mask_distances_;
  DeviceArray<SourceView> views_;
  DeviceArray<ImageView<const float>> full_depths_;
  DeviceArray<ImageView<const unsigned char>> mask_distances_;
  DeviceArray<float> largest_inverse_;
  DeviceArray<uint32_t> selected_views_;  ///< where the prior's numbers have the place of the depths
  DeviceMap<SupportPoint> support_points_, flooded_points_;
  DeviceArray<TriangleCorners> triangles_;  ///< of the prior
  DeviceArray<PlaneHypothesis> planes_;     ///< of these
  DeviceMap<float> evidence_;

  // Of filling and fusion; the first two of RemoveUnsupported, too.
  DeviceMap<SeedCell> fitted_;
  DeviceMap<NearestSeeds> nearest_;
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
