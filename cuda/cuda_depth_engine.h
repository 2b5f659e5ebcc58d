#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "engine_handles.h"
#include "fill_runner.h"
#include "fusion_runner.h"
#include "map_kernels.h"
#include "pass_runner.h"
#include "staged_copy.h"

namespace acmp {

/// The engine of one GPU (see DepthEngine); those that Share() made have the device in common.
class CudaDepthEngine final : public DepthEngine {
 public:
  explicit CudaDepthEngine(const CudaDevicePtr& device) : runner_(device), fill_(device), fusion_(device) {}

  std::unique_ptr<DepthEngine> Share() override;
  EngineImagePtr Load(const FramePtr& frame, int levels) override;
  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override;
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) override;
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) override;
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override;
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override;
  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override;
  EngineEstimatePtr FillUnverified(const EngineProblem& problem, const FillOptions& options) override;
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override;
  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override;
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options) override;
  std::unique_ptr<FusionStamps> MakeFusionStamps() override;
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override;

  EstimateMaps Download(const EngineEstimatePtr& estimate) override;
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override;
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override;
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override;
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate) override;
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override;

  double PopDeviceTime() override { return std::exchange(device_ms_, 0.0); }
  size_t DeviceBytes() const override { return runner_.device()->Bytes(); }
  size_t FreeDeviceBytes() const override;
  std::string device_name() const override;

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

  EngineImagePtr LoadLevels(const Frame& frame, int levels);
  template <Pass kPass>
  EngineEstimatePtr RunPass(const EngineProblem& problem, const PatchMatchOptions& options, int level,
                            const EngineEstimatePtr& start, const PriorMesh* prior, int geometric_pass, int iterations);
  /// The estimate itself if nobody else holds it, else null.
  static std::shared_ptr<CudaEstimate> UseUp(const EngineEstimatePtr& start);
  /// Queues the copy of planes and costs to an estimate of the same size.
  void QueueCopy(const CudaEstimate& from, CudaEstimate* to) const;
  /// An estimate with the start's planes and costs: itself if nobody else holds it, else a copy.
  std::shared_ptr<CudaEstimate> Continue(const EngineEstimatePtr& start) const;
  PassData MakePassData(const EngineProblem& problem, int level, const CudaEstimate& estimate) const;
  /// Throws InvalidInputError unless the sources' estimates are of the level.
  void CheckSourceSizes(const EngineProblem& problem, int level) const;
  void AddSourceDepths(const EngineProblem& problem, PassData* data);
  void AddFullDepths(const EngineProblem& problem, PassData* data) const;
  HalvedDepth HalvedDepthOf(const CudaEstimate& estimate);
  /// Queues the halved depths of an estimate, and the way of their greatest inverse to the host. Once the stream has
  /// been waited for, KeepHalvedDepth takes them.
  DeviceArray<uint16_t> QueueHalvedDepth(const CudaEstimate& estimate);
  void KeepHalvedDepth(DeviceArray<uint16_t> halved, const CudaEstimate& estimate);
  void UploadPrior(const PriorMesh& mesh);
  /// Where the numbers of the pixels' triangles go: the depths of an estimate that is being made, which are set after
  /// the pass.
  static ImageView<uint32_t> NumbersIn(CudaEstimate* estimate);
  /// Draws the uploaded triangles' numbers.
  void QueuePrior(const PatchMatchProblem& match, int triangles, const ImageView<uint32_t>& numbers);
  /// Queues the depths of the estimate's planes.
  void QueueDepths(const PinholeCamera& camera, CudaEstimate* estimate);
  /// As QueueDepths, with the halved depths that geometric passes of others will read: waits for all that was queued
  /// and counts the device's time since begin_ was recorded.
  void FinishSource(const PinholeCamera& camera, CudaEstimate* estimate);
  /// Waits for all that was queued and counts the device's time since begin_ was recorded.
  void FinishTiming();
  std::vector<SupportPoint> FindCells(const CudaEstimate& maps, const DepthRange& range,
                                      const PlanarPriorOptions& options);

  /// What QueueEvidence measures, and of what.
  struct EvidenceSearch {
    CudaMatchContext match;
    FillContext textured;
    ImageView<float> evidence;
  };
  /// The caller holds images_mutex() shared until the stream has been waited for.
  /// @param estimate whose planes are asked about, once QueueEvidence runs
  EvidenceSearch PrepareEvidence(const EngineProblem& problem, CudaEstimate* estimate);
  void QueueEvidence(const EvidenceSearch& search);

  /// Queues the weighted median of a completed estimate.
  /// @param planes of the estimate's size; become those of before, which the stream still reads
  void FilterByMedian(const FusionSetup<DeviceFusionView>& setup, const FillContext& context,
                      const ImageView<const Rgb>& color, CudaEstimate* estimate, DeviceArray<PlaneHypothesis>* planes);
  static PosedCamera PosedCameraOf(const EngineView& view);
  /// Without colours.
  DeviceFusionView GeometryMapsOf(const EngineView& view);
  DeviceFusionView FusionMapsOf(const EngineView& view);
  ImageView<const Rgb> ColorOf(const EngineView& view);
  /// The reference's estimate against the sources' in the reference's camera frame.
  /// @param maps_of GeometryMapsOf or FusionMapsOf
  FusionSetup<DeviceFusionView> SetUp(const EngineView& reference, const std::vector<EngineView>& sources,
                                      const FusionLimits& limits,
                                      DeviceFusionView (CudaDepthEngine::*maps_of)(const EngineView&));
  DeviceArray<Stamp> UnusedStamps(size_t pixels);
  /// Replaces another GPU's stamps by a copy on this one.
  void MoveHere(DeviceArray<Stamp>* stamps);
  /// On this GPU. Nobody else may use the frame's stamps meanwhile.
  ImageView<Stamp> StampsOf(const Frame& frame, CudaStamps* stamps);

  PassRunner runner_;
  FillRunner fill_;
  FusionRunner fusion_;
  CudaEvent begin_, end_;
  PinnedBuffer staging_;
  StagedDownload download_;
  DeviceArray<PlaneHypothesis> prior_planes_;  ///< of the triangles
  DeviceArray<TriangleCorners> triangles_;
  DeviceArray<float> largest_inverse_;
  PinnedBuffer largest_inverse_on_host_;
  DeviceArray<SupportPoint> cells_;
  double device_ms_ = 0;
};

}  // namespace acmp
