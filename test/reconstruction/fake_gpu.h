#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

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

/// An engine that the tool takes for one on a GPU, so that it works with threads.
class FakeGpu final : public FakeMatcherEngine {
 public:
  /// @param behaviour outlives this
  FakeGpu(int device, FakeGpuBehaviour* behaviour)
      : FakeMatcherEngine(&matcher_), device_(device), behaviour_(*behaviour) {}

  std::unique_ptr<DepthEngine> Share() override { return std::make_unique<FakeGpu>(device_, &behaviour_); }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    const int image = static_cast<int>(reference.frame->id);
    behaviour_.before(device_, image, rank);
    PointCloud cloud = FakeMatcherEngine::FuseView(reference, sources, options, rank, stamps);
    behaviour_.after(device_, image, rank);
    return cloud;
  }
  size_t FreeDeviceBytes() const override { return behaviour_.free_bytes; }

 private:
  EngineEstimatePtr Run(const PassRequest& request) override {
    if (request.pass != Pass::kPlanarPrior) behaviour_.before_pass();
    return behaviour_.Watch(FakeMatcherEngine::Run(request));
  }

  FakeMatcher matcher_;
  const int device_;
  FakeGpuBehaviour& behaviour_;
};

}  // namespace acmp
