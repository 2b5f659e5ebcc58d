#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "devices.h"
#include "lru_cache.h"
#include "output_folder.h"
#include "plan.h"
#include "work_files.h"

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

/// Images and estimates of a run where the engines read them: those used last stay on their devices, others are read
/// from the images' and the work folder's files. For any number of threads; an engine by one at a time.
/// What GPUs make is kept in their memory, as far as it goes, and not written to the work folder: that takes longer
/// than making it again after an interruption.
class EngineStore {
 public:
  /// An image's estimate after a step of its schedule: step, scene index.
  using Key = std::pair<int, int>;

  enum class Results {
    kFiles,   ///< a run that is interrupted goes on from its work files
    kMemory,  ///< final maps are fetched at the end; files are for what devices have no room for
  };

  /// All outlive the store. @param output has the work folder
  /// @param steps of an image's schedule; the last one's estimates are final
  EngineStore(FrameStore* frames, const ReconstructOptions& options, const std::filesystem::path& output,
              Results results, const ReconstructPlan& plan, const Devices& devices,
              const std::vector<KeyframeStep>& steps);

  int final_step() const { return final_step_; }
  FramePtr FrameOf(int index) { return frames_.Get(index); }
  /// Where an estimate is if it is in a file.
  std::filesystem::path FileOf(const Key& key) const;
  /// Of a step's work files: "step_0", ..., "final".
  static std::string StepName(int step, int final_step);

  /// The reference image and source views with frames and images; decodes several files side by side.
  EngineProblem Problem(const ImagePlan& image, const DeviceEngine& engine);
  /// The same with all their estimates after a step. Source views without a map keep a null one.
  EngineProblem Problem(const ImagePlan& image, int step, const DeviceEngine& engine);

  /// Keeps an estimate: on its device, and in a file of the work folder if there is no room or the device is the host.
  void Keep(int step, const Frame& frame, const DeviceEngine& engine, const EngineEstimatePtr& estimate);

  /// Announces that so many will read each of the estimates that Problem(image, step) gives.
  void AddReaders(const ImagePlan& image, int step, int count);
  /// One of them has. Frees the memory of estimates that nobody reads any more, and removes their files where what was
  /// made of them is in files for certain.
  void HasRead(const ImagePlan& image, int step);

  /// An image's maps after the last step, to be written.
  std::shared_ptr<const FinalMaps> Final(int index) const;
  /// Frees their memory.
  void ReleaseFinal(int index);

 private:
  struct Unsaved {
    EngineEstimatePtr estimate;
    int device = 0;
    size_t bytes = 0;
  };
  struct Device {
    Device(size_t image_bytes, size_t estimate_bytes, size_t unsaved_bytes)
        : images(image_bytes, kMaxCachedImages), estimates(estimate_bytes), max_unsaved_bytes(unsaved_bytes) {}
    /// A GPU holds at most 2048 images, the layers of a texture: half of them are left for what tasks hold.
    static constexpr size_t kMaxCachedImages = 1024;
    LruCache<int, EngineImage> images;
    LruCache<Key, EngineEstimate> estimates;  ///< copies of what is elsewhere or in a file
    const size_t max_unsaved_bytes;
    size_t unsaved_bytes = 0;        ///< under the store's mutex
    size_t unsaved_final_bytes = 0;  ///< of these those of final estimates: half of the room at most
  };

  EngineImagePtr Image(const FramePtr& frame, const DeviceEngine& engine);
  EngineEstimatePtr Estimate(const Key& key, const Frame& frame, const DeviceEngine& engine);
  EngineEstimatePtr Read(const Key& key, const Frame& frame, const DeviceEngine& engine) const;
  /// @param maps of a final estimate; null: they are not written
  bool KeepUnsaved(const Key& key, const Unsaved& unsaved, std::shared_ptr<const FinalMaps> maps);
  /// Keys of the estimates that Problem(image, step) gives.
  std::vector<Key> Estimates(const ImagePlan& image, int step) const;
  void Forget(const Key& key);

  const std::filesystem::path output_;
  const ReconstructPlan& plan_;
  const int levels_;
  const std::vector<KeyframeStep> steps_;
  const int final_step_;
  FrameStore& frames_;
  std::deque<Device> devices_;
  const bool always_writes_;  ///< the work files
  const bool removes_files_;  ///< that nobody reads any more
  const bool writes_maps_;    ///< of final estimates
  const size_t max_unsaved_map_bytes_;

  mutable std::mutex mutex_;        ///< of what follows
  std::map<Key, Unsaved> unsaved_;  ///< in no file
  std::map<int, std::shared_ptr<const FinalMaps>> unsaved_maps_;
  size_t unsaved_map_bytes_ = 0;
  std::map<Key, int> readers_left_;
};

}  // namespace acmp
