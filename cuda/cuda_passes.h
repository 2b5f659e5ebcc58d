#pragma once

#include <algorithm>
#include <iterator>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <utility>
#include <vector>

#include "acmp_mapping/fill/fill.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "acmp_mapping/planar_prior/kernel/support_grid.h"
#include "cuda_transfers.h"

namespace acmp {

/// The steps that compare images.
class CudaPasses : public CudaTransfers {
 public:
  using CudaTransfers::CudaTransfers;

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

 protected:
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

  // Of filling, too.
  DeviceMap<SeedCell> fitted_;
  DeviceMap<NearestSeeds> nearest_;

 private:
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
};

}  // namespace acmp
