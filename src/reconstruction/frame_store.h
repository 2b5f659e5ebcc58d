#pragma once

#include "acmp_mapping/dataset/scene.h"
#include "lru_cache.h"

namespace acmp {

/// Images of a scene at the size of the run, the ones used last kept in memory. For any number of threads.
class FrameStore {
 public:
  /// @param scene outlives this
  FrameStore(const Scene& scene, const FrameOptions& options, size_t max_bytes)
      : scene_(scene), options_(options), cache_(max_bytes) {}

  FramePtr Get(int index) {
    return cache_.Get(
        index, [&] { return std::make_shared<const Frame>(LoadFrame(scene_, index, options_)); },
        [](const Frame& frame) {
          return frame.gray.size() * sizeof(float) + frame.color.size() * sizeof(Rgb) + frame.mask.size();
        });
  }

 private:
  const Scene& scene_;
  FrameOptions options_;
  LruCache<int, Frame> cache_;
};

}  // namespace acmp
