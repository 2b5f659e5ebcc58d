#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "cuda_fill.h"
#include "cuda_fusion.h"
#include "cuda_image.h"
#include "cuda_passes.h"
#include "cuda_prior.h"
#include "estimate_copies.h"

namespace acmp {

/// The engine of one GPU: each of its parts does one job on the stream that they share. Engines that Share() made have
/// the device in common.
class CudaDepthEngine final : public DepthEngine {
 public:
  explicit CudaDepthEngine(const CudaDevicePtr& device) : queue_(device) {}

  EngineImagePtr Load(const FramePtr& frame, int levels) override { return LoadImage(frame, levels, &queue_); }
  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override {
    return passes_.RunPhotometric(problem, options, level);
  }
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) override {
    return passes_.RunPlanarPrior(problem, options, start, prior);
  }
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) override {
    return passes_.RunGeometric(problem, options, start, pass);
  }
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override {
    return passes_.RestoreDetails(problem, options, start, coarser);
  }
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override {
    return passes_.Upsample(estimate, frame, level);
  }
  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override {
    return prior_.FindSupportPoints(estimate, range, options);
  }
  EngineEstimatePtr FillUnverified(const EngineProblem& problem, EngineEstimatePtr start,
                                   const FillOptions& options) override {
    return fill_.FillUnverified(problem, start, options);
  }
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override {
    return fill_.RemoveUnsupported(problem, start);
  }
  double PopDeviceTime() override { return queue_.PopTime(); }

  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override {
    return fusion_.FilterByConsistency(reference, sources, options);
  }
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options) override {
    return fusion_.MeasureConfidence(reference, sources, options);
  }
  std::unique_ptr<FusionStamps> MakeFusionStamps() override { return CudaFusion::MakeStamps(); }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    return fusion_.FuseView(reference, sources, options, rank, stamps);
  }
  Image<unsigned char> UsedPixels(const Frame& frame, FusionStamps* stamps) override {
    return fusion_.UsedPixels(frame, stamps);
  }
  void SetUsedPixels(const Frame& frame, const Image<unsigned char>& used, FusionStamps* stamps) override {
    fusion_.SetUsedPixels(frame, used, stamps);
  }

  EstimateMaps Download(const EngineEstimatePtr& estimate) override { return copies_.Download(estimate); }
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override { return copies_.DownloadDepth(estimate); }
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override { return copies_.DownloadState(estimate); }
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override {
    return copies_.UploadState(state, camera);
  }
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override {
    return copies_.UploadMaps(maps, camera);
  }
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate) override { return copies_.Import(estimate); }

  std::unique_ptr<DepthEngine> Share() override;
  size_t DeviceBytes() const override { return queue_.device()->Bytes(); }
  size_t FreeDeviceBytes() const override;
  std::string device_name() const override;

 private:
  DeviceQueue queue_;
  HalvedDepths halved_{&queue_};
  CudaPrior prior_{&queue_};
  CudaPasses passes_{&queue_, &halved_, &prior_};
  CudaFill fill_{&queue_, &halved_};
  CudaFusion fusion_{&queue_};
  EstimateCopies copies_{&queue_};
};

}  // namespace acmp
