#pragma once

#include <tbb/task_arena.h>

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/fill/fill.h"
#include "acmp_mapping/fusion/point_losses.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/patch_match/host_passes.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"

namespace acmp {

/// The CPU's engine: images and estimates are in host memory.
class HostDepthEngine : public DepthEngine {
 public:
  std::unique_ptr<DepthEngine> Share() override { return std::make_unique<HostDepthEngine>(); }

  std::string device_name() const override {
    return Concat("cpu (", tbb::this_task_arena::max_concurrency(), " threads)");
  }

  EngineImagePtr Load(const FramePtr& frame, int levels) override {
    CheckLoad(frame, levels);
    auto image = std::make_shared<HostImage>();
    image->frame = frame;
    for (int level = 0; level < levels; ++level) image->halved.push_back(Halve(image->Gray(level)));
    image->mask_distances = MakeMaskDistances(*frame, levels);
    return image;
  }

  EngineEstimatePtr RunPass(const EngineProblem& problem, const PatchMatchOptions& options, EnginePass pass) override {
    const bool is_geometric = pass.kind == Pass::kGeometric;
    const int level = is_geometric ? LevelOfEstimate(problem, pass.start) : pass.level;
    const PatchMatchProblem match = MakeProblem(problem, level, is_geometric);
    const PinholeCamera& camera = match.reference.camera;
    return Keep(camera, [&] {
      Image<uint32_t> numbers;
      PriorMesh of_grid;
      PriorMap prior;
      if (pass.kind == Pass::kPlanarPrior) {
        if (pass.grid_prior != nullptr) {
          const HostEstimate& from = Cast<HostEstimate>(pass.start);
          of_grid = MakeGridMesh(camera, from.depth.View(), from.cost.View(), match.depth_range, *pass.grid_prior);
        }
        const PriorMesh& mesh = pass.prior != nullptr ? *pass.prior : of_grid;
        numbers = RasterizePrior(camera, mesh, match.depth_range);
        prior = {mesh.planes.data(), numbers.View()};
      }
      EstimateState start;
      if (pass.kind != Pass::kPhotometric) start = MakeStart(pass.start);
      return acmp::RunPass(match, options, pass.kind, std::move(start), prior, pass.geometric_pass);
    });
  }

  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override {
    const HostEstimate& halved = Cast<HostEstimate>(estimate);
    CheckUpsample(frame, level, halved.planes.width(), halved.planes.height());
    const PinholeCamera& camera = frame->camera;
    EstimateState state = {PlaneMap(camera.width, camera.height), CostMap(camera.width, camera.height)};
    const RayGrid rays = MakeRayGrid(camera), halved_rays = MakeRayGrid(CameraAtLevel(camera, level));
    ForEachPixel(camera.width, camera.height, [&](int col, int row) {
      const int from_col = CoveringPixel(col, level, halved.planes.width());
      const int from_row = CoveringPixel(row, level, halved.planes.height());
      state.planes(col, row) =
          UpsamplePlane(halved.planes(from_col, from_row),
                        halved_rays.Ray(static_cast<float>(from_col), static_cast<float>(from_row)),
                        rays.Ray(static_cast<float>(col), static_cast<float>(row)));
      state.cost(col, row) = halved.cost(from_col, from_row);
    });
    return UploadState(std::move(state), camera);
  }

  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override {
    const HostEstimate& host = Cast<HostEstimate>(estimate);
    return acmp::FindSupportPoints(host.depth.View(), host.cost.View(), range, options);
  }

  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override {
    const PatchMatchProblem match = MakeProblem(problem, LevelOfEstimate(problem, start), false);
    const PlaneMap& halved = Cast<HostEstimate>(coarser).planes;
    return Keep(match.reference.camera,
                [&] { return acmp::RestoreDetails(match, options, MakeStart(start), halved.View()); });
  }

  EngineEstimatePtr FillUnverified(const EngineProblem& problem, EngineEstimatePtr start,
                                   const FillOptions& options) override {
    const HostEstimate& from = Cast<HostEstimate>(start);
    EngineView reference = problem.reference;
    reference.estimate = start;
    const FusionSetup setup = SetUpFusion(reference, problem.sources, ConsistencyLimits(), MapsOf);
    return Keep(setup.camera(), [&] {
      EstimateState state = {from.planes.Clone(), from.cost.Clone()};
      acmp::FillUnverified(setup, problem.depth_range, options, state.planes.View(), state.cost.View());
      return state;
    });
  }

  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override {
    const PatchMatchProblem match = MakeProblem(problem, 0, true);
    const PinholeCamera& camera = match.reference.camera;
    return Keep(camera, [&] {
      EstimateState state = MakeStart(start);
      const Image<float> evidence = MeasureEvidence(match, state.planes, EvidenceCellSize(camera.width, camera.height));
      acmp::RemoveUnsupported(camera, evidence.View(), state.planes.View(), state.cost.View());
      return state;
    });
  }

  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override {
    return acmp::FilterByConsistency(SetUpFusion(reference, sources, MakeFusionLimits(options), MapsOf));
  }

  /// What becomes of the reference's pixels in FilterByConsistency (CountPointLosses).
  PointLosses CountLosses(const EngineView& reference, const std::vector<EngineView>& sources,
                          const FusionOptions& options, int step) {
    return CountPointLosses(SetUpFusion(reference, sources, MakeFusionLimits(options), MapsOf), step);
  }

  std::unique_ptr<FusionStamps> MakeFusionStamps() override { return std::make_unique<HostStamps>(); }

  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    HostStamps& host_stamps = CastHostStamps(stamps);
    const auto stamps_of = [&](const Frame& frame) { return host_stamps.Of(frame); };
    return acmp::FuseView(
        SetUpFusion(reference, sources, MakeFusionLimits(options), MapsOf, stamps_of, StampOfRank(rank)));
  }

  EstimateMaps Download(const EngineEstimatePtr& estimate) override {
    const HostEstimate& host = Cast<HostEstimate>(estimate);
    return {host.depth.Clone(), ToNormalMap(host.planes), host.cost.Clone()};
  }

  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override {
    return Cast<HostEstimate>(estimate).depth.Clone();
  }

  EstimateState DownloadState(const EngineEstimatePtr& estimate) override {
    const HostEstimate& host = Cast<HostEstimate>(estimate);
    return {host.planes.Clone(), host.cost.Clone()};
  }

  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override {
    CheckUpload(state, camera);
    auto estimate = std::make_shared<HostEstimate>();
    estimate->planes = std::move(state.planes);
    estimate->cost = std::move(state.cost);
    estimate->depth = ToDepthMap(estimate->planes, camera);
    return estimate;
  }

  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override {
    auto estimate = std::make_shared<HostEstimate>();
    estimate->planes = MakePlanes(maps, camera);
    estimate->depth = Clone(maps.depth);
    estimate->cost = Clone(maps.cost);
    return estimate;
  }

  double PopDeviceTime() override { return std::exchange(device_ms_, 0.0); }
  size_t DeviceBytes() const override { return 0; }
  size_t FreeDeviceBytes() const override { return 0; }

 private:
  struct HostImage final : EngineImage {
    FramePtr frame;  ///< keeps the pixels of level 0
    std::vector<GrayImage> halved;
    std::vector<MaskDistanceMap> mask_distances;  ///< of all levels; empty maps where the frame has no mask

    ImageView<const float> Gray(int level) const {
      if (level > static_cast<int>(halved.size())) {
        throw InvalidInputError(Concat("level = ", level, ": the image was loaded with ", halved.size()));
      }
      return level == 0 ? frame->gray.View() : halved[static_cast<size_t>(level) - 1].View();
    }

    /// Sets grey values and mask of a view.
    void SetPixels(int level, MatchView* view) const {
      view->gray = Gray(level);
      view->mask_distance = mask_distances[static_cast<size_t>(level)].View();
    }
  };

  struct HostEstimate final : EngineEstimate {
    PlaneMap planes;
    CostMap cost;
    DepthMap depth;
  };

  struct HostStamps final : FusionStamps {
    std::mutex mutex;  ///< of the map, not of the stamps: views that are fused at the same time have no frame in common
    std::map<int64_t, Image<Stamp>> by_frame;

    ImageView<Stamp> Of(const Frame& frame) {
      const std::lock_guard<std::mutex> lock(mutex);
      auto found = by_frame.find(frame.id);
      if (found == by_frame.end()) {
        found = by_frame.emplace(frame.id, Image<Stamp>(frame.camera.width, frame.camera.height, kUnfusedStamp)).first;
      }
      return found->second.View();
    }
  };

  static HostStamps& CastHostStamps(FusionStamps* stamps) {
    auto* host_stamps = dynamic_cast<HostStamps*>(stamps);
    if (host_stamps == nullptr) throw InvalidInputError("stamps: null or of another device");
    return *host_stamps;
  }

  template <class Handle, class Base>
  static const Handle& Cast(const std::shared_ptr<const Base>& handle) {
    const auto* cast = dynamic_cast<const Handle*>(handle.get());
    if (cast == nullptr) throw InvalidInputError("a handle is null or belongs to another device");
    return *cast;
  }

  /// Means of 2 x 2 pixels.
  static GrayImage Halve(const ImageView<const float>& image) {
    GrayImage halved(image.width / 2, image.height / 2);
    ForEachPixel(halved.width(), halved.height(), [&](int col, int row) {
      halved(col, row) = 0.25f * (image(2 * col, 2 * row) + image(2 * col + 1, 2 * row) + image(2 * col, 2 * row + 1) +
                                  image(2 * col + 1, 2 * row + 1));
    });
    return halved;
  }

  /// @param with_depths of the sources' estimates, which must be of the same level
  static PatchMatchProblem MakeProblem(const EngineProblem& problem, int level, bool with_depths) {
    PatchMatchProblem match = MakePatchMatchProblem(problem, level);
    Cast<HostImage>(problem.reference.image).SetPixels(level, &match.reference);
    for (size_t i = 0; i < match.sources.size(); ++i) {
      const EngineView& source = problem.sources[i];
      Cast<HostImage>(source.image).SetPixels(level, &match.sources[i]);
      if (with_depths && source.estimate) match.sources[i].depth = Cast<HostEstimate>(source.estimate).depth.View();
    }
    return match;
  }

  static int LevelOfEstimate(const EngineProblem& problem, const EngineEstimatePtr& estimate) {
    const PlaneMap& planes = Cast<HostEstimate>(estimate).planes;
    return LevelOf(problem, planes.width(), planes.height());
  }

  static EstimateState MakeStart(const EngineEstimatePtr& estimate) {
    const HostEstimate& host = Cast<HostEstimate>(estimate);
    if (!IsUnique(estimate)) return {host.planes.Clone(), host.cost.Clone()};
    auto& used_up = const_cast<HostEstimate&>(host);  // it was not made const, and nobody is left to see it
    return {std::move(used_up.planes), std::move(used_up.cost)};
  }

  static FusionMaps MapsOf(const EngineView& view) {
    const HostEstimate& estimate = Cast<HostEstimate>(view.estimate);
    return {estimate.depth.View(), estimate.planes.View(), estimate.cost.View(), view.frame->color.View()};
  }

  /// Keeps the result of work(), and counts its time.
  template <class Work>
  EngineEstimatePtr Keep(const PinholeCamera& camera, const Work& work) {
    const Timer timer;
    EstimateState state = work();
    device_ms_ += timer.Elapsed();
    return UploadState(std::move(state), camera);
  }

  double device_ms_ = 0;
};

}  // namespace acmp
