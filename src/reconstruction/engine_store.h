#pragma once

#include <tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/pipeline/presets.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "devices.h"
#include "output_folder.h"
#include "plan.h"
#include "work_files.h"

namespace acmp {

/// Keeps the values used last, up to a number of bytes. A value that is larger than all of it is handed
/// out but not kept. Any number of threads may ask; a value that several want is made once, and different ones at the
/// same time.
template <class Key, class Value>
class LruCache {
 public:
  using Pointer = std::shared_ptr<const Value>;

  explicit LruCache(size_t max_bytes) : max_bytes_(max_bytes) {}

  /// The value of a key; made by `make` when it is not there. `bytes_of` says how large it is. Where `make` throws,
  /// each of those who wait for the value tries for himself.
  Pointer Get(const Key& key, const std::function<Pointer()>& make,
              const std::function<size_t(const Value&)>& bytes_of) {
    const std::shared_ptr<Entry> entry = Touch(key);
    const std::lock_guard<std::mutex> lock(entry->making);
    if (!entry->value) {
      // While it waits for its own loops this thread must not take up work that waits for this value.
      tbb::this_task_arena::isolate([&] { entry->value = make(); });
      Count(key, entry, bytes_of(*entry->value));
    }
    return entry->value;
  }

  /// Forgets a value; no effect when it is not there. One that is being made still goes to all who wait for it, but is
  /// not kept.
  void Drop(const Key& key) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = entries_.find(key); found != entries_.end()) Erase(found);
  }

 private:
  struct Entry {
    std::mutex making;  ///< held while the value is made
    Pointer value;
    size_t bytes = 0;       ///< 0: not made yet
    uint64_t last_use = 0;  ///< its number
  };
  using Entries = std::map<Key, std::shared_ptr<Entry>>;

  /// The entry of a key, which is the one used last from now on.
  std::shared_ptr<Entry> Touch(const Key& key) {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::shared_ptr<Entry>& entry = entries_[key];
    if (!entry) entry = std::make_shared<Entry>();
    entry->last_use = ++uses_;
    return entry;
  }

  void Count(const Key& key, const std::shared_ptr<Entry>& entry, size_t bytes) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end() || found->second != entry) return;  // dropped meanwhile
    entry->bytes = bytes;
    bytes_ += bytes;
    const auto is_older = [](const auto& a, const auto& b) {
      const Entry &first = *a.second, &second = *b.second;
      return first.bytes > 0 && (second.bytes == 0 || first.last_use < second.last_use);
    };
    while (bytes_ > max_bytes_) Erase(std::min_element(entries_.begin(), entries_.end(), is_older));
  }

  void Erase(typename Entries::iterator entry) {
    bytes_ -= entry->second->bytes;
    entries_.erase(entry);
  }

  const size_t max_bytes_;
  std::mutex mutex_;
  Entries entries_;
  uint64_t uses_ = 0;
  size_t bytes_ = 0;  ///< of all that are made
};

/// Images of a scene at the size of the run. For any number of threads.
class FrameStore {
 public:
  /// Reads them from their files, the ones used last kept in memory. @param scene outlives this
  /// @param max_size of MakeFrame
  FrameStore(const Scene& scene, int max_size, size_t max_bytes)
      : load_([=, &scene](int index) { return std::make_shared<const Frame>(LoadFrame(scene, index, max_size)); }),
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

/// Images and estimates of a run where the engines read them: on the devices as far as there is room, beyond in files
/// of the work folder or, where results stay in memory, there. For any number of threads; an engine by one at a time.
/// What GPUs make is not written while they have room: that takes longer than making it again after an interruption.
class EngineStore {
 public:
  /// An image's estimate after a step of its schedule: step, scene index.
  using Key = std::pair<int, int>;

  /// All outlive the store. Files are what devices have no room for and, of the host, everything, as long as somebody
  /// reads it; with --keep-work, and in a stage, as no process can count on the memory of another, everything for good.
  /// @param output has the work folder; empty: there are no files
  EngineStore(FrameStore* frames, const ReconstructOptions& options, const std::filesystem::path& output,
              const ReconstructPlan& plan, const Devices& devices);

  /// Of the schedule: its estimates are final.
  int final_step() const { return final_step_; }
  /// Where an estimate is if it is in a file; of the online schedule, the final maps.
  std::filesystem::path FileOf(const Key& key) const {
    return OutputFolder::WorkFile(output_, StepName(key.first, final_step_), key.second);
  }
  /// Of a step's work files: "step_0", ..., "final".
  static std::string StepName(int step, int final_step);
  /// Whether an earlier run has left an estimate. Reads its whole file.
  WorkFileState FindFile(const Key& key) const {
    return output_.empty() ? WorkFileState::kMissing : CheckWorkFile(FileOf(key));
  }

  /// The reference image and source views with frames and images; decodes several files side by side.
  /// @param step after which all their estimates are there, of source views with a map; -1: none
  EngineProblem Problem(const ImagePlan& image, int step, const DeviceEngine& engine);

  void Keep(int step, const Frame& frame, const DeviceEngine& engine, const EngineEstimatePtr& estimate);

  /// Announces one who will read the estimates that Problem(image, step) gives.
  void AddReader(const ImagePlan& image, int step);
  /// One of them has. Frees the memory of estimates that nobody reads any more, and removes their files where what was
  /// made of them is in files for certain.
  void HasRead(const ImagePlan& image, int step);

 private:
  struct OnDevice {
    EngineEstimatePtr estimate;
    int device = 0;
    size_t bytes = 0;
  };
  struct Device {
    Device(size_t image_bytes, size_t estimate_bytes, size_t own_bytes)
        : least_image_bytes(image_bytes / kMaxCachedImages),
          images(image_bytes),
          estimates(estimate_bytes),
          max_own_bytes(own_bytes) {}
    /// A GPU holds at most 2048 images, the layers of a texture: half of them are left for what tasks hold.
    static constexpr size_t kMaxCachedImages = 1024;
    const size_t least_image_bytes;  ///< that an image counts
    LruCache<int, EngineImage> images;
    LruCache<Key, EngineEstimate> estimates;  ///< copies of what is elsewhere
    const size_t max_own_bytes;
    size_t own_bytes = 0;        ///< of estimates that are only here, under the store's mutex
    size_t own_final_bytes = 0;  ///< of these those of final estimates: half of the room at most
  };

  EngineImagePtr Image(const FramePtr& frame, const DeviceEngine& engine);
  EngineEstimatePtr Estimate(const Key& key, const Frame& frame, const DeviceEngine& engine);
  EngineEstimatePtr Read(const Key& key, const Frame& frame, const DeviceEngine& engine) const;
  bool KeepOnDevice(const Key& key, const OnDevice& kept);
  void Forget(const Key& key);

  const std::filesystem::path output_;
  const ReconstructPlan& plan_;
  const int levels_;
  const std::vector<KeyframeStep> steps_;
  const int final_step_;
  FrameStore& frames_;
  std::deque<Device> devices_;
  const bool keeps_files_;      ///< that nobody reads any more
  const bool always_writes_;    ///< the work files
  const bool finals_are_maps_;  ///< in the work files

  mutable std::mutex mutex_;                                       ///< of what follows
  std::map<Key, OnDevice> on_device_;                              ///< and nowhere else
  std::map<Key, std::shared_ptr<const EstimateState>> in_memory_;  ///< of the host, instead of files
  std::map<Key, int> readers_left_;
};

}  // namespace acmp
