#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/scene.h"
#include "lru_cache.h"

namespace acmp {

/// Images of a scene at the size of the run. For any number of threads.
class FrameStore {
 public:
  /// Reads them from their files, the ones used last kept in memory. @param scene outlives this
  FrameStore(const Scene& scene, const FrameOptions& options, size_t max_bytes)
      : load_([&scene, options](int index) { return std::make_shared<const Frame>(LoadFrame(scene, index, options)); }),
        cache_(max_bytes) {}

  /// All of them, in memory. @param frames of scene index 0, 1, ..., with that as their id
  explicit FrameStore(std::vector<FramePtr> frames)
      : load_([frames = std::move(frames)](int index) { return frames.at(static_cast<size_t>(index)); }), cache_(0) {}

  FramePtr Get(int index) {
    return cache_.Get(
        index, [&] { return load_(index); },
        [](const Frame& frame) {
          return frame.gray.size() * sizeof(float) + frame.color.size() * sizeof(Rgb) + frame.mask.size() +
                 frame.prior_depth.size() * sizeof(float);
        });
  }

 private:
  const std::function<FramePtr(int)> load_;
  LruCache<int, Frame> cache_;
};

}  // namespace acmp
