#include "cuda_depth_engine.h"

#include "acmp_mapping/backend/depth_engine_cuda.h"

namespace acmp {

std::unique_ptr<DepthEngine> CudaDepthEngine::Share() {
  queue_.device()->MakeCurrent();
  return std::make_unique<CudaDepthEngine>(queue_.device());
}

size_t CudaDepthEngine::FreeDeviceBytes() const {
  queue_.device()->MakeCurrent();
  size_t free = 0, total = 0;
  CudaCheck(cudaMemGetInfo(&free, &total), "read free memory");
  return free;
}

std::string CudaDepthEngine::device_name() const {
  const CudaDevice& device = *queue_.device();
  const std::string share =
      device.share() == nullptr
          ? ""
          : Concat(", ", device.multiprocessors(), " of ", device.properties().multiProcessorCount, " multiprocessors");
  return Concat(device.properties().name, " (cuda:", device.index(), share, ")");
}

std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int cuda_index, int multiprocessors) {
  return std::make_unique<CudaDepthEngine>(std::make_shared<CudaDevice>(cuda_index, multiprocessors));
}

}  // namespace acmp
