#include <algorithm>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/fusion_setup.h"
#include "reconstruct_clouds.h"
#include "reconstruct_image_files.h"
#include "reconstruct_run.h"
#include "reconstruct_work_files.h"

namespace acmp {
namespace {

constexpr const char* kWrittenMark = "written";
constexpr size_t kImagesPerSync = 16;  // waiting for the disk takes as long for many files as for one

/// The output steps of a run. Confidences and points are made on the engines, files by other threads.
class ResultWriter {
 public:
  explicit ResultWriter(ReconstructRun* run)
      : run_(*run),
        fusion_(MakePipelineOptions(run->options).fusion),
        files_(run),
        waiting_(&run->folder, run->options.MemoryBytes(run->options.kCloudShare)),
        cloud_(run->folder.path() / "fused.ply") {
    run_.folder.MakeWorkFolder(kWrittenMark);
    for (int device = 0; device < NumDevices(run_); ++device) AddFusionEngine(device);
    stamps_ = fusion_engines_.front().engine->MakeFusionStamps();
  }

  /// Throws InvalidInputError when there are more images than a fusion can tell apart.
  void AddTasks(const std::map<int, int>& final_maps, TaskGraph* graph) {
    CheckRange("number of images to fuse", static_cast<int>(run_.plan.images.size()), 0, kMaxFusionViews);
    std::vector<int> all_written, all_in_cloud;
    std::vector<int> last_placed;  // or none
    for (const ImagePlan& image : run_.plan.images) {
      if (!image.no_map.empty()) continue;
      const int index = image.index;
      const std::vector<int> maps = MapsRead(final_maps, image);
      std::vector<int> before = maps;
      if (files_.HasConfidence()) {
        const int pool = EnginePoolOf(run_, index);
        before = {graph->Add(
            pool, maps, [this, &image, pool](int thread) { MakeConfidence(image, EngineOf(run_, pool, thread)); },
            true)};
      }
      CountReaders(image);
      all_written.push_back(graph->Add(kHostPool, before, [this, index](int) { WriteFiles(index); }));
      const int fused = AddFusion(image, maps, graph);
      const size_t rank = images_.size();
      last_placed = {graph->Add(
          kHostPool, Joined({fused}, last_placed), [this, rank](int) { Place(rank); }, true)};
      all_in_cloud.push_back(graph->Add(kHostPool, last_placed, [this, rank](int) { WritePoints(rank); }));
      images_.push_back(index);
    }
    places_.resize(images_.size());
    clouds_.resize(files_.colmap() ? images_.size() : 0);
    graph->Add(kHostPool, all_written, [this](int) { FinishFiles(); });
    graph->Add(kHostPool, all_in_cloud, [this](int) { FinishCloud(); });
    if (files_.colmap()) {
      graph->Add(kHostPool, all_in_cloud, [this](int) { files_.colmap()->WriteModel(images_, clouds_); });
    }
  }

  static constexpr int kStepsPerImage = 2;
  size_t images() const { return images_.size(); }
  size_t points() const { return cloud_.points(); }

 private:
  /// One of its own for each device, as views are fused while others are matched.
  void AddFusionEngine(int device) {
    ReconstructEngine engine = run_.engines[static_cast<size_t>(EngineOf(run_, kFirstEnginePool + device, 0))];
    if (!engine.on_host) {
      owned_engines_.push_back(engine.engine->Share());
      engine.engine = owned_engines_.back().get();
    }
    fusion_engines_.push_back(engine);
  }

  /// Adds the fusion of a view, on the device of its image. It reads and writes the stamps of its frames: for each it
  /// waits for the view that did so last, and with that for all before. So it finds the stamps that it would find if
  /// the views were fused one after the other.
  int AddFusion(const ImagePlan& image, std::vector<int> after, TaskGraph* graph) {
    const std::vector<int> frames = Joined({image.index}, SourcesOf(image));
    for (int frame : frames) {
      if (const auto last = last_fused_.find(frame); last != last_fused_.end()) after.push_back(last->second);
    }
    const int rank = static_cast<int>(images_.size());
    const int task =
        graph->Add(FusionPoolOf(run_, image.index), after, [this, &image, rank](int) { Fuse(image, rank); });
    for (int frame : frames) last_fused_[frame] = task;
    return task;
  }

  /// All whose maps the image's own are compared with.
  std::vector<int> MapsRead(const std::map<int, int>& final_maps, const ImagePlan& image) const {
    std::vector<int> tasks;
    if (final_maps.empty()) return tasks;
    tasks.push_back(final_maps.at(image.index));
    for (int source : SourcesOf(image)) tasks.push_back(final_maps.at(source));
    return tasks;
  }

  /// Of the final estimates that are compared with the image's: its confidences and its fusion.
  void CountReaders(const ImagePlan& image) {
    const size_t readers = files_.HasConfidence() ? 2 : 1;
    for (int read : Joined({image.index}, SourcesOf(image))) readers_left_[read] += readers;
  }

  /// One of the image's readers is done. Memory for the estimates of which it was the last one is free then.
  void ForgetWhatAllHaveRead(const ImagePlan& image) {
    for (int read : Joined({image.index}, SourcesOf(image))) {
      {
        const std::lock_guard<std::mutex> lock(readers_mutex_);
        if (--readers_left_.at(read) > 0) continue;
      }
      run_.store.Forget(EngineStore::kFinalStage, read);
    }
  }

  static std::vector<int> Joined(std::vector<int> tasks, const std::vector<int>& others) {
    tasks.insert(tasks.end(), others.begin(), others.end());
    return tasks;
  }

  bool IsWritten(int index) const {
    return std::filesystem::exists(run_.folder.WorkFile(kWrittenMark, index)) && files_.AllExist(index);
  }

  /// A view with its final estimate.
  EngineView ViewOf(int index, const ReconstructEngine& engine) {
    EngineView view = run_.store.View(index, engine);
    view.estimate = run_.store.Estimate(EngineStore::kFinalStage, *view.frame, engine);
    return view;
  }

  /// Source views that have a map.
  std::vector<int> SourcesOf(const ImagePlan& image) const {
    std::vector<int> sources;
    std::copy_if(image.sources.begin(), image.sources.end(), std::back_inserter(sources),
                 [this](int source) { return run_.store.HasMap(source); });
    return sources;
  }

  std::vector<EngineView> SourceViewsOf(const ImagePlan& image, const ReconstructEngine& engine) {
    std::vector<EngineView> views;
    for (int source : SourcesOf(image)) views.push_back(ViewOf(source, engine));
    return views;
  }

  void MakeConfidence(const ImagePlan& image, int engine_number) {
    const int index = image.index;
    if (!IsWritten(index) && run_.store.Final(index).confidence().empty()) MeasureConfidence(image, engine_number);
    ForgetWhatAllHaveRead(image);
  }

  void MeasureConfidence(const ImagePlan& image, int engine_number) {
    const ReconstructEngine& engine = run_.engines[static_cast<size_t>(engine_number)];
    const EngineView reference = ViewOf(image.index, engine);
    const std::vector<EngineView> sources = SourceViewsOf(image, engine);
    Timer timer;
    ConfidenceMap confidence = engine.engine->MeasureConfidence(reference, sources, fusion_);
    run_.interrupt.Check();
    const std::lock_guard<std::mutex> lock(mutex_);
    confidences_[image.index] = std::move(confidence);
    const std::lock_guard<std::mutex> times_lock(run_.times_mutex);
    run_.times.consistency_ms += timer.Lap();
  }

  void Fuse(const ImagePlan& image, int rank) {
    const ReconstructEngine& engine = fusion_engines_[static_cast<size_t>(DeviceOf(run_, image.index))];
    const EngineView reference = ViewOf(image.index, engine);
    const std::vector<EngineView> sources = SourceViewsOf(image, engine);
    Timer timer;
    PointCloud cloud = engine.engine->FuseView(reference, sources, fusion_, rank, stamps_.get());
    run_.interrupt.Check();
    ForgetWhatAllHaveRead(image);
    waiting_.Put(image.index, std::move(cloud));
    run_.progress.Step();
    const std::lock_guard<std::mutex> times_lock(run_.times_mutex);
    run_.times.fusion_ms += timer.Lap();
  }

  /// A view's points follow those of all before it; how many those are is known when they are fused.
  void Place(size_t rank) { places_[rank] = cloud_.Reserve(waiting_.NumPoints(images_[rank])); }

  /// Writes a view's points, and forgets them unless COLMAP's model is made of them.
  void WritePoints(size_t rank) {
    Timer timer;
    PointCloud cloud = waiting_.Take(images_[rank]);
    cloud_.WriteAt(places_[rank], cloud);
    if (files_.colmap()) clouds_[rank] = std::move(cloud);
    const std::lock_guard<std::mutex> times_lock(run_.times_mutex);
    run_.times.cloud_ms += timer.Lap();
  }

  void WriteFiles(int index) {
    const bool done = IsWritten(index);
    if (!done) {
      WriteImage(index);
      run_.store.ReleaseFinal(index);
      const std::lock_guard<std::mutex> lock(mutex_);
      if (IsWholeWorkFile(run_.folder.WorkFile(EngineStore::kFinalStage, index))) unmarked_.push_back(index);
      if (unmarked_.size() >= kImagesPerSync) MarkWritten();
    }
    run_.progress.Step(done);
  }

  /// A mark says that an image's files are on the disk for good. Where its final maps are in no work file it would be
  /// of no use.
  void MarkWritten() {
    Timer timer;
    SyncFolder(run_.folder.path());
    {
      const std::lock_guard<std::mutex> lock(run_.times_mutex);
      run_.times.syncing_ms += timer.Lap();
    }
    for (int index : unmarked_) WriteFileAtomically(run_.folder.WorkFile(kWrittenMark, index), "");
    unmarked_.clear();
  }

  void FinishFiles() {
    if (!unmarked_.empty()) MarkWritten();
    if (too_far_ > 0) {
      run_.progress.Warn(
          Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
    }
    WriteCameraList(run_, images_);
  }

  void WriteImage(int index) {
    const StoredFinalMaps maps = run_.store.Final(index);
    ConfidenceMap made;
    ImageView<const float> confidence = maps.confidence();
    if (confidence.empty() && files_.HasConfidence()) {
      const std::lock_guard<std::mutex> lock(mutex_);
      made = std::move(confidences_.at(index));
      confidences_.erase(index);
      confidence = made;
    }
    Timer timer;
    const size_t too_far = files_.Write(index, maps, confidence);
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    too_far_ += too_far;
    run_.times.writing_ms += timer.Lap();
  }

  void FinishCloud() {
    Timer timer;
    cloud_.Commit();
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    run_.times.cloud_ms += timer.Lap();
  }

  ReconstructRun& run_;
  const FusionOptions fusion_;
  std::vector<std::unique_ptr<DepthEngine>> owned_engines_;
  std::vector<ReconstructEngine> fusion_engines_;  ///< per device
  std::unique_ptr<FusionStamps> stamps_;
  const ImageFiles files_;
  WaitingClouds waiting_;
  PlyFile cloud_;
  std::vector<int> images_;         ///< with maps, by scene index: in the order of the cloud
  std::vector<size_t> places_;      ///< of the views' first points in the cloud
  std::vector<PointCloud> clouds_;  ///< the views', for COLMAP's model; else none
  std::map<int, int> last_fused_;   ///< the last task that uses the stamps of a frame

  size_t too_far_ = 0;  ///< pixels; under times_mutex while images are written

  std::mutex mutex_;  ///< of what follows
  std::map<int, ConfidenceMap> confidences_;
  std::vector<int> unmarked_;

  std::mutex
      readers_mutex_;  ///< of what follows: mutex_ is held while files go to the disk, which fusion must not wait for
  std::map<int, size_t> readers_left_;  ///< of an image's final estimate
};

}  // namespace

size_t RunAndWriteResults(ReconstructRun* run, const std::map<int, int>& final_maps, TaskGraph* graph) {
  ResultWriter writer(run);
  writer.AddTasks(final_maps, graph);
  const PipelineOptions pipeline = MakePipelineOptions(run->options);
  const int stages = final_maps.empty() ? 0 : 1 + NumRefinements(pipeline);
  const int steps = stages + ResultWriter::kStepsPerImage;
  const double output = StepCosts::kOutput + StepCosts::kFusion;
  const double maps = stages == 0 ? 0 : EstimateCost(pipeline);
  run->progress.Begin(stages == 0 ? "maps, pictures and cloud" : "depth maps, pictures and cloud",
                      static_cast<int>(writer.images()) * steps, (maps + output) / steps);
  graph->Run(PoolThreads(*run), run->interrupt);
  return writer.points();
}

}  // namespace acmp
