#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/engine/host_depth_engine.h"
#include "reconstruction/fake_matcher.h"

namespace acmp {

/// How fake GPUs behave, and what they have made. Told of their fusions, by the thread that fuses.
struct FakeGpuBehaviour {
  size_t free_bytes = size_t{1} << 30;  ///< at the start of a run, each
  std::function<void()> before_pass = [] {};
  std::function<void(int device, int image, int rank)> before = [](int, int, int) {};
  std::function<void(int device, int image, int rank)> after = [](int, int, int) {};

  EngineEstimatePtr Watch(EngineEstimatePtr estimate) {
    const std::lock_guard<std::mutex> lock(mutex);
    estimates.push_back(estimate);
    return estimate;
  }
  size_t NumEstimatesAlive() {
    const std::lock_guard<std::mutex> lock(mutex);
    return static_cast<size_t>(
        std::count_if(estimates.begin(), estimates.end(), [](const auto& estimate) { return !estimate.expired(); }));
  }
  std::mutex mutex;
  std::vector<std::weak_ptr<const EngineEstimate>> estimates;
};

/// An engine that the tool takes for one on a GPU, so that it works with threads, over the fake matcher.
class FakeGpu final : public HostDepthEngine {
 public:
  /// @param behaviour outlives this
  FakeGpu(int device, FakeGpuBehaviour* behaviour)
      : HostDepthEngine(&MakeFakePatchMatch), device_(device), behaviour_(*behaviour) {}

  std::unique_ptr<DepthEngine> Share() override { return std::make_unique<FakeGpu>(device_, &behaviour_); }
  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override {
    behaviour_.before_pass();
    return behaviour_.Watch(HostDepthEngine::RunPhotometric(problem, options, level));
  }
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) override {
    return behaviour_.Watch(HostDepthEngine::RunPlanarPrior(problem, options, std::move(start), prior));
  }
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) override {
    behaviour_.before_pass();
    return behaviour_.Watch(HostDepthEngine::RunGeometric(problem, options, std::move(start), pass));
  }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    const int image = static_cast<int>(reference.frame->id);
    behaviour_.before(device_, image, rank);
    PointCloud cloud = HostDepthEngine::FuseView(reference, sources, options, rank, stamps);
    behaviour_.after(device_, image, rank);
    return cloud;
  }
  size_t FreeDeviceBytes() const override { return behaviour_.free_bytes; }

 private:
  static std::unique_ptr<PatchMatch> MakeFakePatchMatch() { return std::make_unique<FakePatchMatch>(); }

  const int device_;
  FakeGpuBehaviour& behaviour_;
};

}  // namespace acmp
