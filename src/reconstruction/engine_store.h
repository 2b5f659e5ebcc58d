#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "reconstruct_engine.h"
#include "reconstruct_folder.h"
#include "reconstruct_frames.h"
#include "reconstruct_lru_cache.h"
#include "reconstruct_options.h"
#include "reconstruct_plan.h"
#include "reconstruct_work_files.h"

namespace acmp {

/// Images and estimates of a run where the engines read them: those used last stay on their devices, others are read
/// from the images' and the work folder's files. For any number of threads; an engine by one at a time.
/// What GPUs make is kept in their memory, as far as it goes, and not written to the work folder: that takes longer
/// than making it again after an interruption. The caller says when nobody reads an estimate any more.
class EngineStore {
 public:
  static constexpr const char* kFinalStage = "final";

  /// All outlive the store.
  EngineStore(FrameStore* frames, const ReconstructOptions& options, const ReconstructFolder& folder,
              const ReconstructPlan& plan, const std::vector<ReconstructEngine>& engines);

  bool HasMap(int index) const;

  /// The reference image and source views with frames and images; decodes several files side by side.
  EngineProblem Problem(const ImagePlan& image, const ReconstructEngine& engine);
  EngineView View(int index, const ReconstructEngine& engine);

  /// An image's estimate after a stage.
  EngineEstimatePtr Estimate(const std::string& stage, const Frame& frame, const ReconstructEngine& engine);
  /// The same for each of the source views; those without a map keep a null estimate.
  void AddEstimates(const std::string& stage, const ReconstructEngine& engine, std::vector<EngineView>* sources);

  /// Keeps an estimate: on its device, and in a file of the work folder if there is no room or the device is the host.
  void Keep(const std::string& stage, const Frame& frame, const ReconstructEngine& engine,
            const EngineEstimatePtr& estimate);
  /// The same for final maps.
  void KeepFinal(const Frame& frame, const std::vector<int>& sources, const ReconstructEngine& engine,
                 const EngineEstimatePtr& estimate);
  StoredFinalMaps Final(int index) const;
  /// Frees the memory of an image's final maps, once its files are written. Its sources are kept.
  void ReleaseFinal(int index);

  /// Frees the memory of an estimate that nobody reads any more. Its work file, if it has one, and a final one's maps
  /// on the host stay.
  void Forget(const std::string& stage, int index);

 private:
  using EstimateKey = std::pair<std::string, int>;  ///< stage, scene index
  struct Unsaved {
    EngineEstimatePtr estimate;
    int device = 0;
    size_t bytes = 0;
  };
  struct Device {
    Device(size_t image_bytes, size_t estimate_bytes, size_t unsaved_bytes)
        : images(image_bytes), estimates(estimate_bytes), max_unsaved_bytes(unsaved_bytes) {}
    LruCache<int, EngineImage> images;
    LruCache<EstimateKey, EngineEstimate> estimates;  ///< copies of what is elsewhere or in a file
    const size_t max_unsaved_bytes;
    size_t unsaved_bytes = 0;        ///< under the store's mutex
    size_t unsaved_final_bytes = 0;  ///< of these those of final estimates: half of the room at most
  };

  EngineImagePtr Image(const FramePtr& frame, const ReconstructEngine& engine);
  EngineEstimatePtr Read(const EstimateKey& key, const Frame& frame, const ReconstructEngine& engine) const;
  static void FetchFinal(const Frame& frame, const ReconstructEngine& engine, const EngineEstimatePtr& estimate,
                         FinalMaps* maps);
  /// @param host_bytes of the final maps that come with it
  bool KeepUnsaved(const EstimateKey& key, const Unsaved& unsaved, size_t host_bytes);

  const ReconstructFolder& folder_;
  const ReconstructPlan& plan_;
  const int levels_;
  FrameStore& frames_;
  std::map<int, Device> devices_;
  const bool always_writes_;       ///< the work files
  const bool final_maps_on_host_;  ///< to be written
  const size_t max_unsaved_host_bytes_;

  mutable std::mutex mutex_;  ///< of what follows: what is in no file
  std::map<EstimateKey, Unsaved> unsaved_;
  std::map<int, std::shared_ptr<const FinalMaps>> unsaved_final_;
  size_t unsaved_host_bytes_ = 0;
};

}  // namespace acmp
