#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/scene.h"
#include "reconstruct_engine.h"
#include "reconstruct_folder.h"
#include "reconstruct_lru_cache.h"
#include "reconstruct_options.h"
#include "reconstruct_plan.h"

namespace acmp {

/// Images of a scene at the size of the run, the ones used last kept in memory. For any number of threads.
class FrameStore {
 public:
  FrameStore(const Scene& scene, int max_image_size, size_t max_bytes);
  FramePtr Get(int index);

 private:
  const Scene& scene_;
  int max_image_size_;
  LruCache<int, Frame> cache_;
};

/// Images and estimates of a run where the engines read them: those used last stay on their devices, others are read
/// from the images' and the work folder's files. For any number of threads; an engine by one at a time.
class EngineStore {
 public:
  static constexpr const char* kFinalStage = "final";

  /// All outlive the store.
  EngineStore(const Scene& scene, const ReconstructOptions& options, const ReconstructFolder& folder,
              const ReconstructPlan& plan, const std::vector<ReconstructEngine>& engines);

  bool HasMap(int index) const;

  /// The reference image and source views with frames and images; decodes several files side by side.
  EngineProblem Problem(const ImagePlan& image, const ReconstructEngine& engine);
  EngineView View(int index, const ReconstructEngine& engine);

  /// An image's estimate after a stage.
  EngineEstimatePtr Estimate(const std::string& stage, const Frame& frame, const ReconstructEngine& engine);
  /// The same for each of the source views; those without a map keep a null estimate.
  void AddEstimates(const std::string& stage, const ReconstructEngine& engine, std::vector<EngineView>* sources);

  /// Keeps an estimate on its device. Its file must be written before others ask for it.
  void Keep(const std::string& stage, const Frame& frame, const ReconstructEngine& engine,
            const EngineEstimatePtr& estimate);

 private:
  using EstimateKey = std::pair<std::string, int>;  ///< stage, scene index
  struct Device {
    Device(size_t image_bytes, size_t estimate_bytes) : images(image_bytes), estimates(estimate_bytes) {}
    LruCache<int, EngineImage> images;
    LruCache<EstimateKey, EngineEstimate> estimates;
  };

  EngineImagePtr Image(const FramePtr& frame, const ReconstructEngine& engine);
  EngineEstimatePtr ReadFromFile(const std::string& stage, const Frame& frame, const ReconstructEngine& engine) const;

  const ReconstructFolder& folder_;
  const ReconstructPlan& plan_;
  const int levels_;
  FrameStore frames_;
  std::map<int, Device> devices_;
};

}  // namespace acmp
