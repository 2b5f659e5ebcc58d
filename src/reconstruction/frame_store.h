#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/scene.h"
#include "input_hash.h"
#include "lru_cache.h"

namespace acmp {

/// Images of a scene at the size of the run. For any number of threads.
class FrameStore {
 public:
  /// What is done about files that are written after they have been read.
  enum class Changes {
    kIgnored,  ///< during one run
    kRead,     ///< an image whose files have been written since is read again
  };

  /// Reads them from their files, the ones used last kept in memory. @param scene outlives this
  FrameStore(const Scene& scene, const FrameOptions& options, size_t max_bytes, Changes changes = Changes::kIgnored)
      : load_([&scene, options](int index) { return std::make_shared<const Frame>(LoadFrame(scene, index, options)); }),
        cache_(max_bytes) {
    if (changes == Changes::kIgnored) return;
    stamp_ = [&scene](int index) { return StampOfFiles(scene.images[static_cast<size_t>(index)]); };
  }

  /// All of them, in memory. @param frames of scene index 0, 1, ..., with that as their id
  explicit FrameStore(std::vector<FramePtr> frames)
      : load_([frames = std::move(frames)](int index) { return frames.at(static_cast<size_t>(index)); }), cache_(0) {}

  FramePtr Get(int index) {
    return cache_.Get(
        {index, stamp_(index)}, [&] { return load_(index); },
        [](const Frame& frame) {
          return frame.gray.size() * sizeof(float) + frame.color.size() * sizeof(Rgb) + frame.mask.size() +
                 frame.prior_depth.size() * sizeof(float);
        });
  }

 private:
  const std::function<FramePtr(int)> load_;
  std::function<uint64_t(int)> stamp_ = [](int) { return uint64_t{0}; };  ///< of an image's files
  LruCache<std::pair<int, uint64_t>, Frame> cache_;
};

}  // namespace acmp
