#pragma once

#include "acmp_mapping/dataset/scene.h"
#include "reconstruct_lru_cache.h"

namespace acmp {

/// Images of a scene at the size of the run, the ones used last kept in memory. For any number of threads.
class FrameStore {
 public:
  FrameStore(const Scene& scene, const FrameOptions& options, size_t max_bytes);
  FramePtr Get(int index);

 private:
  const Scene& scene_;
  FrameOptions options_;
  LruCache<int, Frame> cache_;
};

}  // namespace acmp
