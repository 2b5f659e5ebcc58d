#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/common/timer.h"
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
/// What GPUs make in the first seconds of a run is kept in memory, as far as the limit goes, and not written to the
/// work folder: that would take longer than making it again after an interruption.
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

  /// Keeps an estimate: on its device, and in a file of the work folder unless the run is young.
  void Keep(const std::string& stage, const Frame& frame, const ReconstructEngine& engine,
            const EngineEstimatePtr& estimate);
  /// The same for final maps.
  void KeepFinal(const Frame& frame, const std::vector<int>& sources, const ReconstructEngine& engine,
                 const EngineEstimatePtr& estimate);
  StoredFinalMaps Final(int index) const;
  /// Frees the memory of an image's final maps, once its files are written. Its sources are kept.
  void ReleaseFinal(int index);

  /// Forgets all estimates of a stage that no later one reads.
  void DropStage(const std::string& stage);

 private:
  using EstimateKey = std::pair<std::string, int>;  ///< stage, scene index
  struct Unsaved {
    EngineEstimatePtr estimate;
    int device = 0;
    size_t device_bytes = 0, host_bytes = 0;
  };
  struct Device {
    Device(size_t image_bytes, size_t estimate_bytes) : images(image_bytes), estimates(estimate_bytes) {}
    LruCache<int, EngineImage> images;
    LruCache<EstimateKey, EngineEstimate> estimates;
  };

  EngineImagePtr Image(const FramePtr& frame, const ReconstructEngine& engine);
  bool KeepsInMemory(const ReconstructEngine& engine, size_t device_bytes, size_t host_bytes) const;
  EngineEstimatePtr Read(const EstimateKey& key, const Frame& frame, const ReconstructEngine& engine) const;
  static void FetchFinal(const Frame& frame, const ReconstructEngine& engine, const EngineEstimatePtr& estimate,
                         FinalMaps* maps);
  bool KeepUnsaved(const EstimateKey& key, const Unsaved& unsaved, const ReconstructEngine& engine);

  const ReconstructFolder& folder_;
  const ReconstructPlan& plan_;
  const int levels_;
  FrameStore& frames_;
  std::map<int, Device> devices_;
  const bool always_writes_;       ///< the work files
  const bool final_maps_on_host_;  ///< to be written
  const size_t max_unsaved_host_bytes_;
  size_t max_unsaved_device_bytes_ = 0;
  Timer age_;

  mutable std::mutex mutex_;  ///< of what follows: what is in no file
  std::map<EstimateKey, Unsaved> unsaved_;
  std::map<int, std::shared_ptr<const FinalMaps>> unsaved_final_;
  size_t unsaved_device_bytes_ = 0, unsaved_host_bytes_ = 0;
};

}  // namespace acmp
