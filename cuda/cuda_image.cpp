#include "cuda_image.h"

#include <shared_mutex>
#include <utility>

#include "staged_copy.h"

namespace acmp {

ImageLayer::ImageLayer(CudaDevicePtr device, int level, int width, int height, const CudaStream& stream)
    : device_(std::move(device)),
      level_(level),
      layer_(device_->images(level).Acquire(width, height, stream, &device_->images_mutex())) {}

ImageLayer::~ImageLayer() { device_->images(level_).Release(layer_); }

int CudaImage::Layer(int level) const {
  if (level >= static_cast<int>(levels.size())) {
    throw InvalidInputError(Concat("level = ", level, ": the image was loaded with ", levels.size() - 1));
  }
  return levels[static_cast<size_t>(level)]->layer();
}

namespace {

/// The frame's mask, if it has one, for all levels of its image.
void UploadMask(const Frame& frame, int levels, DeviceQueue* queue, CudaImage* image) {
  if (frame.mask.empty()) return;
  for (const MaskDistanceMap& mask_distance : MakeMaskDistances(frame, levels)) {
    DeviceArray<unsigned char> copy(queue->device(), mask_distance.size());
    unsigned char* staged = queue->staging()->Reserve<unsigned char>(mask_distance.size());
    ParallelCopy(mask_distance.data(), mask_distance.size(), staged);
    copy.Upload(staged, mask_distance.size(), queue->stream());
    queue->stream().Synchronize();
    image->mask_distance_views.push_back(
        {copy.data(), mask_distance.width(), mask_distance.height(), mask_distance.width()});
    image->mask_distances.push_back(std::move(copy));
  }
}

}  // namespace

EngineImagePtr LoadImage(const FramePtr& frame, int levels, DeviceQueue* queue) {
  CheckLoad(frame, levels);
  return queue->OnDevice([&] {
    const CudaStream& stream = queue->stream();
    CudaDevice& device = *queue->device();
    auto image = std::make_shared<CudaImage>();
    image->device = &device;
    PinholeCamera camera = frame->camera;
    for (int level = 0; level <= levels; ++level, camera = camera.Halved()) {
      image->levels.push_back(
          std::make_unique<ImageLayer>(queue->device(), level, camera.width, camera.height, stream));
    }
    const std::shared_lock<std::shared_mutex> images(device.images_mutex());
    device.images(0).Upload(frame->gray.View(), image->Layer(0), queue->staging(), stream);
    for (int level = 1; level <= levels; ++level) {
      device.images(level).QueueHalf(device.images(level - 1), image->Layer(level - 1), image->Layer(level), stream);
    }
    stream.Synchronize();
    UploadMask(*frame, levels, queue, image.get());
    return EngineImagePtr(image);
  });
}

ImageView<const Rgb> ColorOf(const EngineView& view, DeviceQueue* queue) {
  const ColorImage& color = view.frame->color;
  if (color.empty()) return {};
  const CudaImage& image = queue->Cast<CudaImage>(view.image);
  const std::lock_guard<std::mutex> lock(image.color_mutex);
  if (image.color.size() == 0) {
    DeviceArray<Rgb> copy(queue->device(), color.size());
    Rgb* staged = queue->staging()->Reserve<Rgb>(color.size());
    ParallelCopy(color.data(), color.size(), staged);
    copy.Upload(staged, color.size(), queue->stream());
    queue->stream().Synchronize();
    image.color = std::move(copy);
  }
  return {image.color.data(), color.width(), color.height(), color.width()};
}

}  // namespace acmp
