#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/fusion/kernel/fusion_context.h"
#include "acmp_mapping/patch_match/kernel/halved_depth.h"
#include "cuda_device.h"
#include "pass_runner.h"

namespace acmp {

/// An image's levels as layers of textures.
struct CudaImage final : EngineImage {
  const CudaDevice* device = nullptr;
  std::vector<std::unique_ptr<ImageLayer>> levels;
  mutable std::mutex color_mutex;
  mutable DeviceArray<Rgb> color;  ///< copied when it is first asked for: matching does without

  int Layer(int level) const {
    if (level >= static_cast<int>(levels.size())) {
      throw InvalidInputError(Concat("level = ", level, ": the image was loaded with ", levels.size() - 1));
    }
    return levels[static_cast<size_t>(level)]->layer();
  }
};

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
  ImageView<const float> CostView() const { return {cost.data(), width, height, width}; }
  ImageView<const float> DepthView() const { return {depth.data(), width, height, width}; }

  const CudaDevice* device;
  int width, height;
  DeviceArray<PlaneHypothesis> planes;
  DeviceArray<float> cost, depth;
  mutable std::mutex halved_mutex;
  mutable DeviceArray<uint16_t> inverse_depth;  ///< of HalvedDepth; empty until it is asked for or known to be
  mutable float inverse_step = 0;
};

/// Each frame's stamps are on the GPU that used them last.
class CudaStamps final : public FusionStamps {
 public:
  /// A frame's stamps, empty at first; stays where it is. They are not locked: views that are fused at the same time
  /// have no frame in common.
  DeviceArray<Stamp>& Of(int64_t frame) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return by_frame_[frame];
  }

 private:
  std::mutex mutex_;
  std::map<int64_t, DeviceArray<Stamp>> by_frame_;
};

}  // namespace acmp
