#include <oneapi/tbb/parallel_invoke.h>

#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "reconstruct_colmap.h"
#include "reconstruct_run.h"
#include "reconstruct_work_files.h"

namespace acmp {
namespace {

constexpr const char* kWrittenMark = "written";
constexpr size_t kImagesPerSync = 16;  // waiting for the disk takes as long for many files as for one

template <class T>
Image<T> Copy(ImageView<const T> view) {
  Image<T> image(view.width, view.height);
  for (int row = 0; row < view.height; ++row) std::copy_n(&view(0, row), view.width, &image(0, row));
  return image;
}

/// The output steps of a run. Confidences and points are made on the engines, files by other threads.
class ResultWriter {
 public:
  explicit ResultWriter(ReconstructRun* run) : run_(*run), fusion_(MakePipelineOptions(run->options).fusion) {
    for (const char* kind : {"depth", "normal", "cost", "confidence"}) MakeFolder(run_.folder.path() / kind);
    run_.folder.MakeWorkFolder(kWrittenMark);
    if (!run_.options.no_pictures) MakeFolder(run_.folder.path() / "pictures");
    if (run_.options.colmap) colmap_.emplace(run);
    const ReconstructEngine& first = run_.engines.front();
    if (!first.on_host) fusion_engine_owner_ = first.engine->Share();
    fusion_engine_ = first;
    if (fusion_engine_owner_) fusion_engine_.engine = fusion_engine_owner_.get();
    stamps_ = fusion_engine_.engine->MakeFusionStamps();
  }

  void AddTasks(const std::map<int, int>& final_maps, TaskGraph* graph) {
    std::vector<int> all_written;
    int last_fused = -1;
    for (const ImagePlan& image : run_.plan.images) {
      if (!image.no_map.empty()) continue;
      const std::vector<int> maps = MapsRead(final_maps, image);
      const int index = image.index;
      const int pool = EnginePoolOf(run_, index);
      const int confidence = graph->Add(
          pool, maps, [this, index, pool](int thread) { MakeConfidence(index, EngineOf(run_, pool, thread)); }, true);
      all_written.push_back(graph->Add(kHostPool, {confidence}, [this, index](int) { WriteFiles(index); }));
      std::vector<int> before = maps;
      if (last_fused >= 0) before.push_back(last_fused);
      last_fused = graph->Add(kFusionPool, before, [this, index](int) { Fuse(index); });
      images_.push_back(index);
    }
    graph->Add(kHostPool, all_written, [this](int) { FinishFiles(); });
    graph->Add(kHostPool, {last_fused}, [this](int) { WriteCloud(); });
    if (colmap_) graph->Add(kHostPool, {last_fused}, [this](int) { colmap_->WriteModel(images_, clouds_); });
  }

  static constexpr int kStepsPerImage = 2;
  size_t images() const { return images_.size(); }
  size_t points() const {
    size_t points = 0;
    for (const PointCloud& cloud : clouds_) points += cloud.size();
    return points;
  }

 private:
  /// All whose maps the image's own are compared with.
  static std::vector<int> MapsRead(const std::map<int, int>& final_maps, const ImagePlan& image) {
    std::vector<int> tasks;
    if (final_maps.empty()) return tasks;
    tasks.push_back(final_maps.at(image.index));
    for (int source : image.sources) {
      if (const auto found = final_maps.find(source); found != final_maps.end()) tasks.push_back(found->second);
    }
    return tasks;
  }

  bool IsWritten(int index) const {
    return std::filesystem::exists(run_.folder.WorkFile(kWrittenMark, index)) && AllFilesExist(index);
  }

  /// A view with its final estimate.
  EngineView ViewOf(int index, const ReconstructEngine& engine) {
    EngineView view = run_.store.View(index, engine);
    view.estimate = run_.store.Estimate(EngineStore::kFinalStage, *view.frame, engine);
    return view;
  }

  std::vector<EngineView> SourcesOf(const StoredFinalMaps& maps, const ReconstructEngine& engine) {
    std::vector<EngineView> sources;
    for (int source : maps.sources()) {
      if (run_.store.HasMap(source)) sources.push_back(ViewOf(source, engine));
    }
    return sources;
  }

  void MakeConfidence(int index, int engine_number) {
    const StoredFinalMaps maps = run_.store.Final(index);
    if (IsWritten(index) || !maps.confidence().empty()) return;
    const ReconstructEngine& engine = run_.engines[static_cast<size_t>(engine_number)];
    const EngineView reference = ViewOf(index, engine);
    const std::vector<EngineView> sources = SourcesOf(maps, engine);
    Timer timer;
    ConsistencyResult result = engine.engine->FilterByConsistency(reference, sources, fusion_);
    run_.interrupt.Check();
    const std::lock_guard<std::mutex> lock(mutex_);
    confidences_[index] = std::move(result.confidence);
    const std::lock_guard<std::mutex> times_lock(run_.times_mutex);
    run_.times.consistency_ms += timer.Lap();
  }

  void Fuse(int index) {
    const StoredFinalMaps maps = run_.store.Final(index);
    const EngineView reference = ViewOf(index, fusion_engine_);
    const std::vector<EngineView> sources = SourcesOf(maps, fusion_engine_);
    Timer timer;
    clouds_.push_back(fusion_engine_.engine->FuseView(reference, sources, fusion_, stamps_.get()));
    run_.interrupt.Check();
    run_.progress.Step();
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    run_.times.fusion_ms += timer.Lap();
  }

  std::vector<std::filesystem::path> FilesOf(int index) const {
    const ReconstructFolder& folder = run_.folder;
    std::vector<std::filesystem::path> files = {
        folder.MapFile("depth", index, ".pfm"), folder.MapFile("depth", index, ".png"),
        folder.MapFile("normal", index, ".pfm"), folder.MapFile("cost", index, ".pfm"),
        folder.MapFile("confidence", index, ".pfm")};
    if (run_.options.dmb) files.push_back(folder.MapFile("depth", index, ".dmb"));
    if (colmap_) {
      for (auto& file : colmap_->FilesOf(index)) files.push_back(std::move(file));
    }
    if (run_.options.no_pictures) return files;
    for (const char* suffix : {"_depth.png", "_normal.png", "_cost.png", "_confidence.png"}) {
      files.push_back(folder.MapFile("pictures", index, suffix));
    }
    return files;
  }

  bool AllFilesExist(int index) const {
    for (const auto& file : FilesOf(index)) {
      if (!std::filesystem::exists(file)) return false;
    }
    return true;
  }

  /// The confidence that was made for the image, or that its final maps already have.
  ConfidenceMap TakeConfidence(int index, const StoredFinalMaps& maps) {
    if (!maps.confidence().empty()) return Copy(maps.confidence());
    const std::lock_guard<std::mutex> lock(mutex_);
    ConfidenceMap confidence = std::move(confidences_.at(index));
    confidences_.erase(index);
    return confidence;
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
    const ConfidenceMap confidence = TakeConfidence(index, maps);
    Timer timer;
    const DepthMap depth = Copy(maps.depth());
    const NormalMap normal = Copy(maps.normal());
    const CostMap cost = Copy(maps.cost());
    const ReconstructFolder& folder = run_.folder;
    const bool pictures = !run_.options.no_pictures;
    const auto picture = [&](const char* suffix) { return folder.MapFile("pictures", index, suffix); };
    size_t too_far = 0;
    // One task per quantity: compressing pictures takes longer than writing them.
    tbb::parallel_invoke(
        [&] {
          WritePfm(folder.MapFile("depth", index, ".pfm"), depth);
          if (run_.options.dmb) WriteDmb(folder.MapFile("depth", index, ".dmb"), depth);
          too_far = WriteDepthPng(folder.MapFile("depth", index, ".png"), depth);
        },
        [&] {
          if (pictures) WritePng(picture("_depth.png"), DepthPicture(depth));
        },
        [&] {
          WritePfm(folder.MapFile("normal", index, ".pfm"), normal);
          if (pictures) WritePng(picture("_normal.png"), NormalPicture(normal));
        },
        [&] {
          WritePfm(folder.MapFile("cost", index, ".pfm"), cost);
          if (pictures) WritePng(picture("_cost.png"), CostPicture(cost));
        },
        [&] {
          WritePfm(folder.MapFile("confidence", index, ".pfm"), confidence);
          if (pictures) WritePng(picture("_confidence.png"), ConfidencePicture(confidence));
        },
        [&] {
          if (colmap_) colmap_->WriteMaps(index, Copy(maps.color()), depth, normal, cost);
        });
    for (const auto& file : FilesOf(index)) StartWriteback(file);
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    too_far_ += too_far;
    run_.times.writing_ms += timer.Lap();
  }

  void WriteCloud() {
    Timer timer;
    WriteMergedPly(run_.folder.path() / "fused.ply", clouds_);
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    run_.times.cloud_ms += timer.Lap();
  }

  ReconstructRun& run_;
  const FusionOptions fusion_;
  std::unique_ptr<DepthEngine> fusion_engine_owner_;
  ReconstructEngine fusion_engine_;
  std::unique_ptr<FusionStamps> stamps_;
  std::optional<ColmapOutput> colmap_;  ///< where it is asked for
  std::vector<int> images_;             ///< with maps, by scene index
  std::vector<PointCloud> clouds_;      ///< of each view, world frame

  size_t too_far_ = 0;  ///< pixels; under times_mutex while images are written

  std::mutex mutex_;  ///< of what follows
  std::map<int, ConfidenceMap> confidences_;
  std::vector<int> unmarked_;
};

}  // namespace

size_t RunAndWriteResults(ReconstructRun* run, const std::map<int, int>& final_maps, TaskGraph* graph) {
  ResultWriter writer(run);
  writer.AddTasks(final_maps, graph);
  const PipelineOptions pipeline = MakePipelineOptions(run->options);
  const int stages = final_maps.empty() ? 0 : 1 + NumRefinements(pipeline);
  const int steps = stages + ResultWriter::kStepsPerImage;
  const double output = StepCosts::kOutput + StepCosts::kFusion;
  const double initial = pipeline.use_planar_prior ? StepCosts::kInitialWithPrior : StepCosts::kInitialWithoutPrior;
  const double maps = stages == 0 ? 0 : initial + NumRefinements(pipeline) * StepCosts::kGeometricPass;
  run->progress.Begin(stages == 0 ? "maps, pictures and cloud" : "depth maps, pictures and cloud",
                      static_cast<int>(writer.images()) * steps, (maps + output) / steps);
  graph->Run(PoolThreads(*run), run->interrupt);
  return writer.points();
}

}  // namespace acmp
