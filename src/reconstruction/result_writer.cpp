#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/camera_list.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/fusion/fusion_setup.h"
#include "image_files.h"
#include "run.h"
#include "waiting_clouds.h"

namespace acmp {
namespace {

/// The output steps of a run. Confidences and points are made on the engines, files by other threads.
class ResultWriter {
 public:
  explicit ResultWriter(ReconstructRun* run)
      : run_(*run),
        fusion_(MakePipelineOptions(run->options).fusion),
        files_(run),
        measures_confidence_(files_.HasConfidence() && !run->options.online()),  // online maps come with theirs
        waiting_(&run->folder, run->options.MemoryBytes(run->options.kCloudShare)),
        cloud_(run->folder.path() / "fused.ply"),
        stamps_(run->devices.FusionEngine(0).engine->MakeFusionStamps()) {}

  /// Throws InvalidInputError when there are more images than a fusion can tell apart.
  void AddTasks(const std::map<int, int>& final_maps, TaskGraph* graph) {
    CheckRange("number of images to fuse", static_cast<int>(run_.plan.images.size()), 0, kMaxFusionViews);
    std::vector<int> all_written, all_in_cloud;
    std::vector<int> last_placed;  // or none
    for (const ImagePlan& image : run_.plan.images) {
      if (!image.no_map.empty()) continue;
      const std::vector<int> maps = MapsRead(final_maps, image);
      run_.store.AddReaders(image, run_.store.final_step(), measures_confidence_ ? 2 : 1);
      all_written.push_back(AddFiles(image, maps, graph));
      const int fused = AddFusion(image, maps, graph);
      const size_t rank = images_.size();
      last_placed.push_back(fused);
      last_placed = {graph->Add(
          Devices::kFilePool, last_placed, [this, rank](int) { Place(rank); }, true)};
      all_in_cloud.push_back(graph->Add(Devices::kFilePool, last_placed, [this, rank](int) { WritePoints(rank); }));
      images_.push_back(image.index);
    }
    places_.resize(images_.size());
    clouds_.resize(files_.colmap() ? images_.size() : 0);
    graph->Add(Devices::kFilePool, all_written, [this](int) { FinishFiles(); });
    graph->Add(Devices::kFilePool, all_in_cloud, [this](int) { FinishCloud(); });
  }

  static constexpr int kStepsPerImage = 2;
  size_t images() const { return images_.size(); }
  size_t points() const { return cloud_.points(); }

 private:
  /// Adds an image's files, with its confidence before them on the device of the image.
  int AddFiles(const ImagePlan& image, std::vector<int> after, TaskGraph* graph) {
    if (measures_confidence_) {
      const int device = run_.devices.DeviceOf(image.index);
      after = {graph->Add(
          Devices::EnginePool(device), after,
          [this, &image, device](int thread) { MeasureConfidence(image, run_.devices.Engine(device, thread)); }, true)};
    }
    return graph->Add(Devices::kFilePool, after, [this, &image](int) { WriteFiles(image.index); });
  }

  /// Adds the fusion of a view, on the device of its image. It reads and writes the stamps of its frames: for each it
  /// waits for the view that did so last, and with that for all before. So it finds the stamps that it would find if
  /// the views were fused one after the other.
  int AddFusion(const ImagePlan& image, std::vector<int> after, TaskGraph* graph) {
    const std::vector<int> frames = FramesOf(image);
    for (int frame : frames) {
      if (const auto last = last_fused_.find(frame); last != last_fused_.end()) after.push_back(last->second);
    }
    const int rank = static_cast<int>(images_.size());
    const int device = run_.devices.DeviceOf(image.index);
    const int task = graph->Add(run_.devices.FusionPool(device), after, [this, &image, rank, device](int) {
      Fuse(image, rank, run_.devices.FusionEngine(device));
    });
    for (int frame : frames) last_fused_[frame] = task;
    return task;
  }

  /// The image and its source views that have a map.
  std::vector<int> FramesOf(const ImagePlan& image) const {
    std::vector<int> frames = {image.index};
    for (int source : image.sources) {
      if (run_.plan.HasMap(source)) frames.push_back(source);
    }
    return frames;
  }

  /// Tasks after which the image's map and all that it is compared with are there.
  std::vector<int> MapsRead(const std::map<int, int>& final_maps, const ImagePlan& image) const {
    std::vector<int> tasks;
    if (final_maps.empty()) return tasks;
    for (int frame : FramesOf(image)) tasks.push_back(final_maps.at(frame));
    return tasks;
  }

  void MeasureConfidence(const ImagePlan& image, const DeviceEngine& engine) {
    const EngineProblem problem = run_.store.Problem(image, run_.store.final_step(), engine);
    Timer timer;
    ConfidenceMap confidence = engine.engine->MeasureConfidence(problem.reference, problem.sources, fusion_);
    run_.interrupt.Check();
    run_.store.HasRead(image, run_.store.final_step());
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    confidences_[image.index] = std::move(confidence);
    run_.times.consistency_ms += timer.Lap();
  }

  void Fuse(const ImagePlan& image, int rank, const DeviceEngine& engine) {
    const EngineProblem problem = run_.store.Problem(image, run_.store.final_step(), engine);
    Timer timer;
    PointCloud cloud = engine.engine->FuseView(problem.reference, problem.sources, fusion_, rank, stamps_.get());
    run_.interrupt.Check();
    run_.store.HasRead(image, run_.store.final_step());
    waiting_.Put(image.index, std::move(cloud));
    run_.progress.Step();
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
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
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    run_.times.cloud_ms += timer.Lap();
  }

  void WriteFiles(int index) {
    if (files_.any()) {
      const std::shared_ptr<const FinalMaps> maps = run_.store.Final(index);
      const ConfidenceMap measured = TakeConfidence(index);
      Timer timer;
      const size_t too_far = files_.Write(index, *maps, measures_confidence_ ? measured : maps->confidence);
      const std::lock_guard<std::mutex> lock(run_.times_mutex);
      too_far_ += too_far;
      run_.times.writing_ms += timer.Lap();
    }
    run_.store.ReleaseFinal(index);
    run_.progress.Step();
  }

  /// Empty if none was measured.
  ConfidenceMap TakeConfidence(int index) {
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    const auto measured = confidences_.extract(index);
    return measured ? std::move(measured.mapped()) : ConfidenceMap();
  }

  void FinishFiles() {
    if (too_far_ > 0) {
      run_.progress.Warn(
          Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
    }
    WriteCameraList(run_.folder.path() / "cameras.txt", Cameras());
  }

  void FinishCloud() {
    Timer timer;
    cloud_.Commit();
    {
      const std::lock_guard<std::mutex> lock(run_.times_mutex);
      run_.times.cloud_ms += timer.Lap();
    }
    if (files_.colmap()) files_.colmap()->WriteModel(images_, clouds_);
  }

  /// Cameras and poses of the maps.
  std::vector<ListedCamera> Cameras() const {
    std::vector<ListedCamera> cameras;
    for (int index : images_) {
      const SceneImage& image = run_.scene.images[index];
      cameras.push_back({{index, image.name}, CameraOf(run_, index), image.cam_from_world.inverse()});
    }
    return cameras;
  }

  ReconstructRun& run_;
  const FusionOptions fusion_;
  const ImageFiles files_;
  const bool measures_confidence_;
  WaitingClouds waiting_;
  PlyFile cloud_;
  const std::unique_ptr<FusionStamps> stamps_;
  std::vector<int> images_;         ///< with maps, by scene index: in the order of the cloud
  std::vector<size_t> places_;      ///< of the views' first points in the cloud
  std::vector<PointCloud> clouds_;  ///< the views', for COLMAP's model; else none
  std::map<int, int> last_fused_;   ///< the last task that uses the stamps of a frame

  // Under times_mutex while tasks run.
  size_t too_far_ = 0;  ///< pixels
  std::map<int, ConfidenceMap> confidences_;
};

}  // namespace

PinholeCamera CameraOf(const ReconstructRun& run, int index) {
  const PinholeCamera& camera = run.scene.images[index].camera;
  int width = camera.width;
  int height = camera.height;
  LimitSize(run.options.max_image_size, &width, &height);
  return camera.Resized(width, height);
}

size_t RunAndWriteResults(ReconstructRun* run, const std::map<int, int>& final_maps, TaskGraph* graph) {
  ResultWriter writer(run);
  writer.AddTasks(final_maps, graph);
  const bool all = !final_maps.empty();  // of the run's steps
  const int steps = ResultWriter::kStepsPerImage + (all ? run->store.final_step() + 1 : 0);
  std::optional<double> share;
  constexpr double kShareBeforeMesh = 0.9;
  if (!run->options.mesh.empty()) share = kShareBeforeMesh * (1 - run->progress.done_share());
  run->progress.Begin(all ? "depth maps, pictures and cloud" : "maps, pictures and cloud",
                      static_cast<int>(writer.images()) * steps, share);
  graph->Run(run->devices.PoolThreads(), run->interrupt);
  return writer.points();
}

}  // namespace acmp
