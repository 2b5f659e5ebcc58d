#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "cuda_device.h"

namespace acmp {

/// A map in device memory.
template <class T>
struct DeviceMap {
  DeviceMap() = default;
  DeviceMap(const CudaDevicePtr& device, int map_width, int map_height)
      : width(map_width), height(map_height), pixels(device, static_cast<size_t>(map_width) * map_height) {}

  /// Makes room for so many; contents undefined then. Never less memory than before.
  ImageView<T> Reserve(const CudaDevicePtr& device, int map_width, int map_height) {
    pixels.Reserve(device, static_cast<size_t>(map_width) * map_height);
    width = map_width;
    height = map_height;
    return View();
  }
  ImageView<const T> View() const { return {pixels.data(), width, height, width}; }
  ImageView<T> View() { return {pixels.data(), width, height, width}; }

  int width = 0, height = 0;
  DeviceArray<T> pixels;
};

/// An image's levels as layers of textures, and those of its mask.
struct CudaImage final : EngineImage {
  explicit CudaImage(CudaDevicePtr owner) : device(std::move(owner)) {}
  ~CudaImage() override {
    for (size_t level = 0; level < layers.size(); ++level)
      device->images(static_cast<int>(level)).Release(layers[level]);
  }

  /// Throws InvalidInputError where the image was loaded with fewer levels.
  int Layer(int level) const {
    if (level < static_cast<int>(layers.size())) return layers[static_cast<size_t>(level)];
    throw InvalidInputError(Concat("level = ", level, ": the image was loaded with ", layers.size() - 1));
  }
  /// MaskDistanceMap of the mask of a level that the image has; empty without a mask.
  ImageView<const unsigned char> MaskDistance(int level) const {
    if (mask_distances.empty()) return {};
    return mask_distances[static_cast<size_t>(level)].View();
  }

  const CudaDevicePtr device;
  std::vector<int> layers;                               ///< of the device's images, by level
  std::vector<DeviceMap<unsigned char>> mask_distances;  ///< of all levels (MakeMaskDistances); none without a mask
  mutable std::mutex color_mutex;
  mutable DeviceMap<Rgb> color;  ///< copied when it is first asked for: matching does without
};

/// Planes, costs and the planes' depths in device memory: 24 bytes per pixel, and half a byte where a geometric pass of
/// another view may read it. While a pass makes it, the depths' memory holds the prior's numbers or the selected views.
struct CudaEstimate final : EngineEstimate {
  CudaEstimate(const CudaDevicePtr& owner, int map_width, int map_height)
      : device(owner),
        width(map_width),
        height(map_height),
        planes(owner, width, height),
        cost(owner, width, height),
        depth(owner, width, height) {}

  size_t Pixels() const { return static_cast<size_t>(width) * height; }
  /// The depths' memory for one number per pixel.
  ImageView<uint32_t> NumbersView() {
    static_assert(sizeof(uint32_t) == sizeof(float), "a number takes the place of a depth");
    return {reinterpret_cast<uint32_t*>(depth.pixels.data()), width, height, width};
  }

  const CudaDevicePtr device;
  const int width, height;
  DeviceMap<PlaneHypothesis> planes;
  DeviceMap<float> cost, depth;
  mutable std::mutex halved_mutex;
  mutable DeviceMap<uint16_t> inverse_depth;  ///< of HalvedDepth; empty until it is asked for or known to be
  mutable float inverse_step = 0;
};

/// Each frame's stamps are on the GPU that used them last.
class CudaStamps final : public FusionStamps {
 public:
  /// A frame's stamps on a GPU. They are not locked: views that are fused at the same time have no frame in common.
  DeviceMap<Stamp>& Of(const Frame& frame, const CudaDevicePtr& device, const CudaStream& stream) {
    DeviceMap<Stamp>& stamps = MapOf(frame.id);
    if (stamps.pixels.size() == 0) {
      static_assert(kUnfusedStamp == 0xffff, "both bytes are set to 0xff");
      stamps = DeviceMap<Stamp>(device, frame.camera.width, frame.camera.height);
      CudaCheck(cudaMemsetAsync(stamps.pixels.data(), 0xff, stamps.pixels.size() * sizeof(Stamp), stream.get()),
                "reset stamps");
    } else if (stamps.pixels.device() != device) {
      {
        DeviceMap<Stamp> moved(device, stamps.width, stamps.height);
        moved.pixels.CopyFromPeer(stamps.pixels, stamps.pixels.size(), stream);
        stream.Synchronize();  // before the other GPU gets its memory back
        stamps = std::move(moved);
      }
      device->MakeCurrent();  // freeing selected the other GPU
    }
    return stamps;
  }

 private:
  /// Empty at first; stays where it is.
  DeviceMap<Stamp>& MapOf(int64_t frame) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return by_frame_[frame];
  }

  std::mutex mutex_;
  std::map<int64_t, DeviceMap<Stamp>> by_frame_;
};

}  // namespace acmp
