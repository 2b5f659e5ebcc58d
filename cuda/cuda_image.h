#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "acmp_mapping/engine/engine_problem.h"
#include "device_queue.h"

namespace acmp {

/// A layer of a device's images, given back at the end.
class ImageLayer {
 public:
  ImageLayer(CudaDevicePtr device, int level, int width, int height, const CudaStream& stream);
  ~ImageLayer();
  ImageLayer(const ImageLayer&) = delete;
  ImageLayer& operator=(const ImageLayer&) = delete;

  int layer() const { return layer_; }

 private:
  CudaDevicePtr device_;
  int level_;
  int layer_;
};

/// An image's levels as layers of textures, and those of its mask.
struct CudaImage final : EngineImage {
  const CudaDevice* device = nullptr;
  std::vector<std::unique_ptr<ImageLayer>> levels;
  std::vector<DeviceArray<unsigned char>> mask_distances;  ///< of all levels (MakeMaskDistances); none without a mask
  std::vector<ImageView<const unsigned char>> mask_distance_views;
  mutable std::mutex color_mutex;
  mutable DeviceArray<Rgb> color;  ///< copied when it is first asked for: matching does without

  /// Throws InvalidInputError where the image was loaded with fewer levels.
  int Layer(int level) const;
  /// MaskDistanceMap of the mask of a level that the image has, on the device; empty without a mask.
  ImageView<const unsigned char> MaskDistance(int level) const {
    return mask_distance_views.empty() ? ImageView<const unsigned char>()
                                       : mask_distance_views[static_cast<size_t>(level)];
  }
};

/// See DepthEngine::Load.
EngineImagePtr LoadImage(const FramePtr& frame, int levels, DeviceQueue* queue);

/// The view's colours on the device; empty where the frame has none.
ImageView<const Rgb> ColorOf(const EngineView& view, DeviceQueue* queue);

}  // namespace acmp
