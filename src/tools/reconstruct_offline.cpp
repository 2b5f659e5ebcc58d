#include <map>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/output_file.h"
#include "reconstruct_run.h"
#include "reconstruct_work_files.h"

namespace acmp {
namespace {

constexpr const char* kFinalStage = "final";

/// The steps of the offline schedule. A stage's result of an image is one file, so after an interruption the first one
/// missing is where to go on.
class OfflineSchedule {
 public:
  explicit OfflineSchedule(ReconstructRun* run)
      : run_(*run),
        pipeline_(MakePipelineOptions(run->options)),
        estimator_(&run->patch_match, pipeline_),
        frames_(run->scene, run->options.max_image_size, CacheBytes() / 2),
        depths_(CacheBytes() / 2) {
    for (const ImagePlan& image : run_.plan.images) {
      if (image.no_map.empty()) images_[image.index] = &image;
    }
  }

  void Run() {
    const int stages = 1 + pipeline_.geometric_passes;
    const int first = FirstStageToRun(stages);
    for (int stage = 0; stage < stages; ++stage) {
      BeginProgress(stage);
      for (const auto& [index, image] : images_) {
        const bool done = stage < first || Exists(stage, index);
        if (!done) RunOne(stage, *image);
        run_.progress.Step(done);
      }
      depths_.Clear();
      if (stage > 0 && !run_.options.keep_work)
        run_.folder.RemoveWork(StageName(stage - 1));  // no later stage reads it
    }
  }

 private:
  size_t CacheBytes() const { return static_cast<size_t>(run_.options.memory_limit_gb * 1e9); }

  /// The last stage's results are kept as final maps.
  std::string StageName(int stage) const {
    if (stage == pipeline_.geometric_passes) return kFinalStage;
    return stage == 0 ? "initial" : Concat("geometric_", stage);
  }

  bool Exists(int stage, int index) const { return IsWholeWorkFile(run_.folder.WorkFile(StageName(stage), index)); }

  /// Stages before one that is complete are not needed any more, and may have been removed.
  int FirstStageToRun(int stages) const {
    for (int stage = stages - 1; stage >= 0; --stage) {
      bool complete = true;
      for (const auto& [index, image] : images_) complete &= Exists(stage, index);
      if (complete) return stage + 1;
    }
    return 0;
  }

  void BeginProgress(int stage) {
    const bool prior = pipeline_.use_planar_prior;
    const double initial = prior ? StepCosts::kInitialWithPrior : StepCosts::kInitialWithoutPrior;
    run_.progress.Begin(stage > 0 ? Concat("geometric pass ", stage)
                        : prior   ? "photometric + planar prior"
                                  : "photometric",
                        static_cast<int>(images_.size()), stage == 0 ? initial : StepCosts::kGeometricPass);
    run_.folder.MakeWorkFolder(StageName(stage));
  }

  FramePtr Frame(int index) {
    Timer timer;
    FramePtr frame = frames_.Get(index);
    run_.times.io_ms += timer.Lap();
    return frame;
  }

  void RunOne(int stage, const ImagePlan& image) {
    run_.interrupt.Check();
    const FramePtr reference = Frame(image.index);
    std::vector<FramePtr> sources;
    for (int source : image.sources) sources.push_back(Frame(source));
    const PatchMatchResult result = stage == 0 ? estimator_.EstimateInitial(*reference, sources, image.range)
                                               : Refine(stage, image, *reference, sources);
    run_.interrupt.Check();
    run_.times.Add(estimator_.last_times());
    run_.times.images += stage == 0 ? 1 : 0;
    Save(stage, image, *reference, result);
  }

  PatchMatchResult Refine(int stage, const ImagePlan& image, const acmp::Frame& reference,
                          const std::vector<FramePtr>& sources) {
    const std::string previous = StageName(stage - 1);
    Timer timer;
    const PatchMatchResult start =
        ReadEstimate(run_.folder.WorkFile(previous, image.index), reference.camera.width, reference.camera.height);
    std::vector<std::shared_ptr<const DepthMap>> depths;  // keeps them while the pass runs
    std::vector<const DepthMap*> pointers;
    for (const FramePtr& source : sources) {
      depths.push_back(DepthOf(previous, *source));
      pointers.push_back(depths.back().get());
    }
    run_.times.io_ms += timer.Lap();
    return estimator_.RefineGeometric(reference, sources, pointers, image.range, start, stage - 1);
  }

  /// Depth of a source view after the previous stage; null when it gets no map.
  std::shared_ptr<const DepthMap> DepthOf(const std::string& stage, const acmp::Frame& frame) {
    const int index = static_cast<int>(frame.id);
    if (images_.count(index) == 0) return nullptr;
    return depths_.Get(
        index,
        [&] {
          const PinholeCamera& camera = frame.camera;
          const PlaneMap planes = ReadPlanes(run_.folder.WorkFile(stage, index), camera.width, camera.height);
          return std::make_shared<const DepthMap>(ToDepthMap(planes, camera));
        },
        [](const DepthMap& depth) { return depth.size() * sizeof(float); });
  }

  void Save(int stage, const ImagePlan& image, const acmp::Frame& reference, const PatchMatchResult& result) {
    Timer timer;
    const auto path = run_.folder.WorkFile(StageName(stage), image.index);
    if (StageName(stage) == kFinalStage) {
      FinalMaps maps;
      maps.depth = ToDepthMap(result.planes, reference.camera);
      maps.normal = ToNormalMap(result.planes);
      maps.cost = result.cost.Clone();
      maps.color = reference.color.Clone();
      maps.sources = image.sources;
      run_.interrupt.Check();
      WriteFinalMaps(path, maps);
    } else {
      WriteEstimate(path, result);
    }
    run_.times.io_ms += timer.Lap();
  }

  ReconstructRun& run_;
  PipelineOptions pipeline_;
  DepthEstimator estimator_;
  std::map<int, const ImagePlan*> images_;  ///< that get a map, by scene index
  FrameStore frames_;
  LruCache<int, DepthMap> depths_;
};

}  // namespace

void RunOfflineSchedule(ReconstructRun* run) { OfflineSchedule(run).Run(); }

}  // namespace acmp
