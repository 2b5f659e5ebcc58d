#include <map>
#include <mutex>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/output_file.h"
#include "reconstruct_run.h"
#include "reconstruct_tasks.h"
#include "reconstruct_work_files.h"

namespace acmp {
namespace {

constexpr const char* kFinalStage = "final";

/// What is kept on one device, by scene index.
struct DeviceCaches {
  using EstimateKey = std::pair<int, int>;  ///< stage, scene index

  explicit DeviceCaches(size_t max_bytes) : images(max_bytes / 4), estimates(max_bytes - max_bytes / 4) {}

  LruCache<int, EngineImage> images;
  LruCache<EstimateKey, EngineEstimate> estimates;
};

/// The steps of the offline schedule. A stage's result of an image is one file, so after an interruption the first one
/// missing is where to go on. Each engine works on another image; a geometric pass waits for the estimates it reads.
class OfflineSchedule {
 public:
  explicit OfflineSchedule(ReconstructRun* run)
      : run_(*run),
        pipeline_(MakePipelineOptions(run->options)),
        stages_(1 + pipeline_.geometric_passes),
        frames_(run->scene, run->options.max_image_size, HostBytes() / 2) {
    for (const ImagePlan& image : run_.plan.images) {
      if (image.no_map.empty()) images_[image.index] = &image;
    }
    for (const ReconstructEngine& engine : run_.engines) {
      estimators_.emplace_back(engine.engine, pipeline_);
      if (caches_.count(engine.device) > 0) continue;
      const size_t free = engine.engine->FreeDeviceBytes();
      caches_.emplace(std::piecewise_construct, std::forward_as_tuple(engine.device),
                      std::forward_as_tuple(free > 0 ? free / 2 : HostBytes() / 2));
    }
  }

  void Run() {
    const int first = FirstStageToRun();
    const double initial =
        pipeline_.use_planar_prior ? StepCosts::kInitialWithPrior : StepCosts::kInitialWithoutPrior;
    const double per_image = initial + pipeline_.geometric_passes * StepCosts::kGeometricPass;
    run_.progress.Begin("depth maps", static_cast<int>(images_.size()) * stages_, per_image / stages_);
    for (int stage = 0; stage < stages_; ++stage) AddStage(stage, first);
    graph_.Run({static_cast<int>(run_.engines.size())}, run_.interrupt);
  }

 private:
  size_t HostBytes() const { return static_cast<size_t>(run_.options.memory_limit_gb * 1e9); }

  /// The last stage's results are kept as final maps.
  std::string StageName(int stage) const {
    if (stage == stages_ - 1) return kFinalStage;
    return stage == 0 ? "initial" : Concat("geometric_", stage);
  }

  std::filesystem::path FileOf(int stage, int index) const { return run_.folder.WorkFile(StageName(stage), index); }
  bool Exists(int stage, int index) const { return IsWholeWorkFile(FileOf(stage, index)); }

  /// Stages before one that is complete are not needed any more, and may have been removed.
  int FirstStageToRun() const {
    for (int stage = stages_ - 1; stage >= 0; --stage) {
      bool complete = true;
      for (const auto& [index, image] : images_) complete &= Exists(stage, index);
      if (complete) return stage + 1;
    }
    return 0;
  }

  void AddStage(int stage, int first_stage) {
    run_.folder.MakeWorkFolder(StageName(stage));
    std::map<int, int> tasks;  // by scene index
    for (const auto& [index, image] : images_) {
      const bool done = stage < first_stage || Exists(stage, index);
      tasks[index] = graph_.Add(0, EstimatesReadBy(stage, *image), [this, stage, image, done](int engine) {
        if (!done) RunOne(stage, *image, engine);
        const std::lock_guard<std::mutex> lock(report_mutex_);
        run_.progress.Step(done);
      });
    }
    if (stage > 0 && !run_.options.keep_work) {
      std::vector<int> all;
      for (const auto& [index, task] : tasks) all.push_back(task);
      // No later stage reads it.
      graph_.Add(0, all, [this, stage](int) { run_.folder.RemoveWork(StageName(stage - 1)); });
    }
    previous_stage_ = std::move(tasks);
  }

  /// Tasks of the stage before whose results a pass over the image reads.
  std::vector<int> EstimatesReadBy(int stage, const ImagePlan& image) const {
    if (stage == 0) return {};
    std::vector<int> tasks = {previous_stage_.at(image.index)};
    for (int source : image.sources) {
      if (const auto found = previous_stage_.find(source); found != previous_stage_.end()) {
        tasks.push_back(found->second);
      }
    }
    return tasks;
  }

  void RunOne(int stage, const ImagePlan& image, int engine) {
    DepthEstimator& estimator = estimators_[static_cast<size_t>(engine)];
    Timer timer;
    const EngineProblem problem = MakeProblem(stage, image, engine);
    double io_ms = timer.Lap();
    const EngineEstimatePtr estimate =
        stage == 0 ? estimator.EstimateInitial(problem)
                   : estimator.RefineGeometric(problem, EstimateOf(stage - 1, *problem.reference.frame, engine),
                                               stage - 1);
    run_.interrupt.Check();
    timer.Lap();
    Keep(stage, problem, engine, estimate);
    Save(stage, image, *problem.reference.frame, engine, estimate);
    io_ms += timer.Lap();
    const std::lock_guard<std::mutex> lock(report_mutex_);
    run_.times.Add(estimator.last_times());
    run_.times.images += stage == 0 ? 1 : 0;
    run_.times.io_ms += io_ms;
  }

  EngineProblem MakeProblem(int stage, const ImagePlan& image, int engine) {
    EngineProblem problem;
    problem.depth_range = image.range;
    problem.sources.resize(image.sources.size());
    // Files are decoded side by side.
    tbb::parallel_for(size_t{0}, image.sources.size() + 1, [&](size_t i) {
      if (i == 0) {
        problem.reference.frame = frames_.Get(image.index);
      } else {
        problem.sources[i - 1].frame = frames_.Get(image.sources[i - 1]);
      }
    });
    run_.interrupt.Check();
    problem.reference.image = ImageOf(problem.reference.frame, engine);
    for (EngineView& source : problem.sources) {
      source.image = ImageOf(source.frame, engine);
      const bool has_map = images_.count(static_cast<int>(source.frame->id)) > 0;
      if (stage > 0 && has_map) source.estimate = EstimateOf(stage - 1, *source.frame, engine);
    }
    return problem;
  }

  DeviceCaches& CachesOf(int engine) { return caches_.at(run_.engines[static_cast<size_t>(engine)].device); }
  DepthEngine& Engine(int engine) { return *run_.engines[static_cast<size_t>(engine)].engine; }

  EngineImagePtr ImageOf(const FramePtr& frame, int engine) {
    return CachesOf(engine).images.Get(
        static_cast<int>(frame->id), [&] { return Engine(engine).Load(frame, pipeline_.start_level); },
        [&](const EngineImage&) { return frame->gray.size() * kImageBytesPerPixel; });
  }

  /// After a stage: from the device, or from its file where it has been dropped or was made elsewhere.
  EngineEstimatePtr EstimateOf(int stage, const acmp::Frame& frame, int engine) {
    const int index = static_cast<int>(frame.id);
    const PinholeCamera& camera = frame.camera;
    return CachesOf(engine).estimates.Get(
        {stage, index},
        [&] {
          return Engine(engine).UploadState(ReadEstimate(FileOf(stage, index), camera.width, camera.height), camera);
        },
        [&](const EngineEstimate&) { return frame.gray.size() * kEstimateBytesPerPixel; });
  }

  void Keep(int stage, const EngineProblem& problem, int engine, const EngineEstimatePtr& estimate) {
    const acmp::Frame& frame = *problem.reference.frame;
    CachesOf(engine).estimates.Get(
        {stage, static_cast<int>(frame.id)}, [&] { return estimate; },
        [&](const EngineEstimate&) { return frame.gray.size() * kEstimateBytesPerPixel; });
  }

  void Save(int stage, const ImagePlan& image, const acmp::Frame& reference, int engine,
            const EngineEstimatePtr& estimate) {
    if (StageName(stage) != kFinalStage) {
      WriteEstimate(FileOf(stage, image.index), Engine(engine).DownloadState(estimate));
      return;
    }
    EstimateMaps estimate_maps = Engine(engine).Download(estimate);
    FinalMaps maps;
    maps.depth = std::move(estimate_maps.depth);
    maps.normal = std::move(estimate_maps.normal);
    maps.cost = std::move(estimate_maps.cost);
    maps.color = reference.color.Clone();
    maps.sources = image.sources;
    run_.interrupt.Check();
    WriteFinalMaps(FileOf(stage, image.index), maps);
  }

  // What the caches count: texels of two bytes with their halved images; planes, cost and depth.
  static constexpr size_t kImageBytesPerPixel = 3;
  static constexpr size_t kEstimateBytesPerPixel = 24;

  ReconstructRun& run_;
  const PipelineOptions pipeline_;
  const int stages_;
  std::map<int, const ImagePlan*> images_;  ///< that get a map, by scene index
  FrameStore frames_;
  std::vector<DepthEstimator> estimators_;  ///< per engine
  std::map<int, DeviceCaches> caches_;      ///< per device
  TaskGraph graph_;
  std::map<int, int> previous_stage_;  ///< tasks of the stage added last, by scene index
  std::mutex report_mutex_;
};

}  // namespace

void RunOfflineSchedule(ReconstructRun* run) { OfflineSchedule(run).Run(); }

}  // namespace acmp
