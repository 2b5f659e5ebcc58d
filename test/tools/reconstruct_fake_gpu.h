#pragma once

#include <functional>
#include <memory>
#include <string>

#include "acmp_mapping/pipeline/host_depth_engine.h"
#include "tools/reconstruct_fake_matcher.h"

namespace acmp {

/// How fake GPUs behave. Told of their fusions, by the thread that fuses.
struct FakeGpuBehaviour {
  size_t free_bytes = size_t{1} << 30;  ///< at the start of a run, each
  std::function<void()> before_pass = [] {};
  std::function<void(int device, int image, int rank)> before = [](int, int, int) {};
  std::function<void(int device, int image, int rank)> after = [](int, int, int) {};
};

/// An engine that the tool takes for one on a GPU, so that it works with threads, over the fake matcher.
class FakeGpu final : public DepthEngine {
 public:
  /// @param behaviour outlives this
  FakeGpu(int device, const FakeGpuBehaviour* behaviour) : device_(device), behaviour_(*behaviour) {}

  std::unique_ptr<DepthEngine> Share() override { return std::make_unique<FakeGpu>(device_, &behaviour_); }
  EngineImagePtr Load(const FramePtr& frame, int levels) override { return host_.Load(frame, levels); }
  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override {
    behaviour_.before_pass();
    return host_.RunPhotometric(problem, options, level);
  }
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override {
    return host_.Upsample(estimate, frame, level);
  }
  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override {
    return host_.FindSupportPoints(estimate, range, options);
  }
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) override {
    return host_.RunPlanarPrior(problem, options, std::move(start), prior);
  }
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) override {
    behaviour_.before_pass();
    return host_.RunGeometric(problem, options, std::move(start), pass);
  }
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override {
    return host_.RestoreDetails(problem, options, std::move(start), coarser);
  }
  EngineEstimatePtr Complete(const EngineProblem& problem, const CompletionOptions& options) override {
    return host_.Complete(problem, options);
  }
  EngineEstimatePtr RefuteUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override {
    return host_.RefuteUnsupported(problem, std::move(start));
  }
  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override {
    return host_.FilterByConsistency(reference, sources, options);
  }
  std::unique_ptr<FusionStamps> MakeFusionStamps() override { return host_.MakeFusionStamps(); }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    const int image = static_cast<int>(reference.frame->id);
    behaviour_.before(device_, image, rank);
    PointCloud cloud = host_.FuseView(reference, sources, options, rank, stamps);
    behaviour_.after(device_, image, rank);
    return cloud;
  }
  EstimateMaps Download(const EngineEstimatePtr& estimate) override { return host_.Download(estimate); }
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override { return host_.DownloadState(estimate); }
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override {
    return host_.UploadState(std::move(state), camera);
  }
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override {
    return host_.UploadMaps(maps, camera);
  }
  double TakeDeviceMs() override { return host_.TakeDeviceMs(); }
  size_t DeviceBytes() const override { return 0; }
  size_t FreeDeviceBytes() const override { return behaviour_.free_bytes; }
  std::string device_name() const override { return host_.device_name(); }

 private:
  static std::unique_ptr<PatchMatch> MakeFakePatchMatch() { return std::make_unique<FakePatchMatch>(); }

  const int device_;
  const FakeGpuBehaviour& behaviour_;
  HostDepthEngine host_{&MakeFakePatchMatch};
};

}  // namespace acmp
