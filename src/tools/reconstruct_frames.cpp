#include "reconstruct_frames.h"

namespace acmp {

FrameStore::FrameStore(const Scene& scene, int max_image_size, size_t max_bytes)
    : scene_(scene), max_image_size_(max_image_size), cache_(max_bytes) {}

FramePtr FrameStore::Get(int index) {
  return cache_.Get(
      index, [&] { return std::make_shared<const Frame>(LoadFrame(scene_, index, max_image_size_)); },
      [](const Frame& frame) { return frame.gray.size() * sizeof(float) + frame.color.size() * sizeof(Rgb); });
}

}  // namespace acmp
