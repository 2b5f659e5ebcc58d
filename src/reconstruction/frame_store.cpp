#include "reconstruct_frames.h"

namespace acmp {

FrameStore::FrameStore(const Scene& scene, const FrameOptions& options, size_t max_bytes)
    : scene_(scene), options_(options), cache_(max_bytes) {}

FramePtr FrameStore::Get(int index) {
  return cache_.Get(
      index, [&] { return std::make_shared<const Frame>(LoadFrame(scene_, index, options_)); },
      [](const Frame& frame) { return frame.gray.size() * sizeof(float) + frame.color.size() * sizeof(Rgb); });
}

}  // namespace acmp
