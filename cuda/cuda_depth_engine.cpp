#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "cuda_fill.h"
#include "cuda_fusion.h"
#include "cuda_image.h"
#include "cuda_passes.h"
#include "cuda_prior.h"
#include "estimate_copies.h"

namespace acmp {
namespace {

/// What the parts of an engine share; made before them.
struct EngineQueue {
  explicit EngineQueue(const CudaDevicePtr& device) : queue(device) {}

  DeviceQueue queue;
  HalvedDepths halved{&queue};
};

/// The engine of one GPU: each of its parts does one job on the stream that they share. Engines that Share() made have
/// the device in common.
class CudaDepthEngine final : private EngineQueue,
                              public CudaPrior,
                              public CudaPasses,
                              public CudaFill,
                              public CudaFusion,
                              public EstimateCopies {
 public:
  explicit CudaDepthEngine(const CudaDevicePtr& device)
      : EngineQueue(device),
        CudaPrior(&queue),
        CudaPasses(&queue, &halved, this),
        CudaFill(&queue, &halved),
        CudaFusion(&queue),
        EstimateCopies(&queue) {}

  EngineImagePtr Load(const FramePtr& frame, int levels) override { return LoadImage(frame, levels, &queue); }
  double PopDeviceTime() override { return queue.PopTime(); }
  std::unique_ptr<DepthEngine> Share() override {
    queue.device()->MakeCurrent();
    return std::make_unique<CudaDepthEngine>(queue.device());
  }
  size_t DeviceBytes() const override { return queue.device()->Bytes(); }
  size_t FreeDeviceBytes() const override {
    queue.device()->MakeCurrent();
    size_t free = 0, total = 0;
    CudaCheck(cudaMemGetInfo(&free, &total), "read free memory");
    return free;
  }
  std::string device_name() const override {
    const CudaDevice& device = *queue.device();
    const std::string share = device.share() == nullptr
                                  ? ""
                                  : Concat(", ", device.multiprocessors(), " of ",
                                           device.properties().multiProcessorCount, " multiprocessors");
    return Concat(device.properties().name, " (cuda:", device.index(), share, ")");
  }
};

}  // namespace

std::unique_ptr<DepthEngine> MakeDepthEngineCuda(int cuda_index, int multiprocessors) {
  return std::make_unique<CudaDepthEngine>(std::make_shared<CudaDevice>(cuda_index, multiprocessors));
}

}  // namespace acmp
