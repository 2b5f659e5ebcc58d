#include "cuda_estimate.h"

#include <utility>

#include "map_kernels.h"

namespace acmp {

std::shared_ptr<CudaEstimate> UseUp(const EngineEstimatePtr& start) {
  if (!IsUnique(start)) return nullptr;
  // It was not made const, and nobody is left to see it.
  return std::const_pointer_cast<CudaEstimate>(std::static_pointer_cast<const CudaEstimate>(start));
}

void QueueCopy(const CudaEstimate& from, CudaEstimate* to, const CudaStream& stream) {
  to->planes.CopyFrom(from.planes, from.Pixels(), stream);
  to->cost.CopyFrom(from.cost, from.Pixels(), stream);
}

std::shared_ptr<CudaEstimate> Continue(const EngineEstimatePtr& start, const DeviceQueue& queue) {
  std::shared_ptr<CudaEstimate> used_up = UseUp(start);
  if (!used_up) {
    const CudaEstimate& from = queue.Cast<CudaEstimate>(start);
    auto copy = std::make_shared<CudaEstimate>(queue.device(), from.width, from.height);
    QueueCopy(from, copy.get(), queue.stream());
    return copy;
  }
  used_up->inverse_depth = DeviceArray<uint16_t>();
  return used_up;
}

void QueueDepths(const PinholeCamera& camera, CudaEstimate* estimate, const CudaStream& stream) {
  LaunchToDepth(std::as_const(*estimate).PlaneView(), MakeRayGrid(camera), estimate->depth.data(), stream.get());
}

HalvedDepth HalvedDepths::Of(const CudaEstimate& estimate) {
  const int width = HalvedSize(estimate.width), height = HalvedSize(estimate.height);
  const std::lock_guard<std::mutex> lock(estimate.halved_mutex);
  if (estimate.inverse_depth.size() == 0) {
    queue_.StartClock();
    Make(estimate);
  }
  return {{estimate.inverse_depth.data(), width, height, width}, estimate.inverse_step};
}

void HalvedDepths::Finish(const PinholeCamera& camera, CudaEstimate* estimate) {
  QueueDepths(camera, estimate, queue_.stream());
  Make(*estimate);
}

void HalvedDepths::Make(const CudaEstimate& estimate) {
  const int width = HalvedSize(estimate.width), height = HalvedSize(estimate.height);
  DeviceArray<uint16_t> halved(queue_.device(), static_cast<size_t>(width) * height);
  largest_inverse_.Reserve(queue_.device(), 1);
  LaunchHalveDepth(estimate.DepthView(), largest_inverse_.data(), {halved.data(), width, height, width},
                   queue_.stream().get());
  largest_inverse_.Download(largest_inverse_on_host_.Reserve<float>(1), 1, queue_.stream());
  queue_.FinishClock();
  estimate.inverse_depth = std::move(halved);
  estimate.inverse_step = *largest_inverse_on_host_.Reserve<float>(1) / kInverseSteps;
}

}  // namespace acmp
