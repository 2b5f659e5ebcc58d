#pragma once

#include <memory>
#include <mutex>

#include "acmp_mapping/engine/engine_problem.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "device_queue.h"

namespace acmp {

/// Planes, costs and the planes' depths in device memory: 24 bytes per pixel, and half a byte where a geometric pass of
/// another view may read it. While a pass makes it, the depths' memory holds the prior's numbers or the selected views.
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
  ImageView<PlaneHypothesis> PlaneView() { return {planes.data(), width, height, width}; }
  ImageView<const float> CostView() const { return {cost.data(), width, height, width}; }
  ImageView<float> CostView() { return {cost.data(), width, height, width}; }
  ImageView<const float> DepthView() const { return {depth.data(), width, height, width}; }
  /// The depths' memory for one number per pixel.
  ImageView<uint32_t> NumbersView() {
    static_assert(sizeof(uint32_t) == sizeof(float), "a number takes the place of a depth");
    return {reinterpret_cast<uint32_t*>(depth.data()), width, height, width};
  }

  const CudaDevice* device;
  int width, height;
  DeviceArray<PlaneHypothesis> planes;
  DeviceArray<float> cost, depth;
  mutable std::mutex halved_mutex;
  mutable DeviceArray<uint16_t> inverse_depth;  ///< of HalvedDepth; empty until it is asked for or known to be
  mutable float inverse_step = 0;
};

/// The estimate itself if nobody else holds it, else null.
std::shared_ptr<CudaEstimate> UseUp(const EngineEstimatePtr& start);

/// Queues the copy of planes and costs to an estimate of the same size.
void QueueCopy(const CudaEstimate& from, CudaEstimate* to, const CudaStream& stream);

/// An estimate with the start's planes and costs: itself if nobody else holds it, else a copy that is queued.
std::shared_ptr<CudaEstimate> Continue(const EngineEstimatePtr& start, const DeviceQueue& queue);

/// Queues the depths of the estimate's planes.
void QueueDepths(const PinholeCamera& camera, CudaEstimate* estimate, const CudaStream& stream);

/// Makes the halved depths that geometric passes of other views read.
class HalvedDepths {
 public:
  explicit HalvedDepths(DeviceQueue* queue) : queue_(*queue) {}

  /// Those of an estimate, which keeps them: made now if they have not been.
  HalvedDepth Of(const CudaEstimate& estimate);

  /// Queues the depths of the estimate's planes and halves them, waits for all that was queued and stops the clock.
  void Finish(const PinholeCamera& camera, CudaEstimate* estimate);

 private:
  /// Waits and stops the clock.
  void Make(const CudaEstimate& estimate);

  DeviceQueue& queue_;
  DeviceArray<float> largest_inverse_;
  PinnedBuffer largest_inverse_on_host_;
};

}  // namespace acmp
