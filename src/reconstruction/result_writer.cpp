#include <map>
#include <optional>
#include <set>
#include <utility>

#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/map_io.h"
#include "cloud_output.h"
#include "image_files.h"

namespace acmp {
namespace {

/// The output of a run. Confidences and points are made on the engines, files by other threads.
class ResultWriter {
 public:
  explicit ResultWriter(ReconstructRun* run)
      : run_(*run), files_(run), waiting_(run->folder, run->options.CloudBytes()), cloud_(*run) {}

  void AddTasks(RunTasks* tasks) {
    std::vector<int> all_written, all_in_cloud;
    std::vector<int> last_placed;  // or none
    for (const ImagePlan& image : run_.plan.images) {
      if (!image.no_map.empty()) continue;
      all_written.push_back(files_.AddTasks(image, tasks));
      last_placed.push_back(tasks->AddFusion(
          image, [this, index = image.index](PointCloud cloud) { waiting_.Put(index, std::move(cloud)); }));
      const size_t rank = images_.size();
      last_placed = {tasks->AddFileTask(
          last_placed, [this, rank] { Place(rank); }, true)};
      all_in_cloud.push_back(cloud_.in_order() ? last_placed.back()
                                               : tasks->AddFileTask(last_placed, [this, rank] { WritePoints(rank); }));
      images_.push_back(image.index);
    }
    places_.resize(images_.size());
    clouds_.resize(files_.colmap() ? images_.size() : 0);
    tasks->AddFileTask(all_written, [this] { FinishFiles(); });
    // COLMAP's model reads the maps.
    if (files_.colmap()) all_in_cloud.insert(all_in_cloud.end(), all_written.begin(), all_written.end());
    tasks->AddFileTask(all_in_cloud, [this] { FinishCloud(); });
  }

  static constexpr int kStepsPerImage = 2;
  size_t images() const { return images_.size(); }
  CloudSize cloud_size() const { return cloud_.size(); }

 private:
  /// A view's points follow those of all before it; how many those are is known when they are fused.
  void Place(size_t rank) {
    places_[rank] = cloud_.Reserve(waiting_.NumPoints(images_[rank]));
    if (cloud_.in_order()) WritePoints(rank);
  }

  /// Writes a view's points, and forgets them unless COLMAP's model is made of them.
  void WritePoints(size_t rank) {
    Timer timer;
    PointCloud cloud = waiting_.Take(images_[rank]);
    cloud_.WriteAt(places_[rank], cloud);
    if (files_.colmap()) clouds_[rank] = std::move(cloud);
    run_.Count(&RunTimes::cloud_ms, timer.Lap());
  }

  void FinishFiles() {
    files_.WarnOfDepthsTooFar();
    WriteCameras(run_, images_);
  }

  void FinishCloud() {
    Timer timer;
    cloud_.Commit();
    run_.Count(&RunTimes::cloud_ms, timer.Lap());
    if (files_.colmap()) files_.colmap()->WriteModel(images_, clouds_);
  }

  ReconstructRun& run_;
  ImageFiles files_;
  WaitingClouds waiting_;
  CloudOutput cloud_;
  std::vector<int> images_;         ///< with maps, by scene index: in the order of the cloud
  std::vector<size_t> places_;      ///< of the views' first points in the cloud
  std::vector<PointCloud> clouds_;  ///< the views', for COLMAP's model; else none
};

}  // namespace

PinholeCamera CameraOf(const ReconstructRun& run, int index) {
  const PinholeCamera& camera = run.scene.images[static_cast<size_t>(index)].camera;
  int width = camera.width;
  int height = camera.height;
  LimitSize(run.options.max_image_size, &width, &height);
  return camera.Resized(width, height);
}

void WriteCameras(const ReconstructRun& run, const std::vector<int>& images) {
  std::vector<ListedCamera> cameras;
  for (int index : images) {
    const SceneImage& image = run.scene.images[static_cast<size_t>(index)];
    cameras.push_back({{index, image.name}, CameraOf(run, index), WrittenPose(image)});
  }
  WriteCameraList(run.folder->path() / "cameras.txt", cameras);
}

CloudSize RunAndWriteResults(ReconstructRun* run) {
  RunTasks tasks(run);
  const bool offline = !run->options.online();
  const std::set<StepOfImage> to_do = offline ? tasks.AddMissingSteps() : std::set<StepOfImage>();
  ResultWriter writer(run);
  writer.AddTasks(&tasks);
  const size_t steps = offline ? writer.images() * static_cast<size_t>(run->store.final_step() + 1) : 0;
  std::optional<double> share;
  constexpr double kShareBeforeMesh = 0.9;
  if (!run->options.mesh.empty()) share = kShareBeforeMesh * (1 - run->progress.done_share());
  run->progress.Begin(offline ? "depth maps, pictures and cloud" : "maps, pictures and cloud",
                      static_cast<int>(steps + writer.images() * ResultWriter::kStepsPerImage), share);
  for (size_t reused = to_do.size(); reused < steps; ++reused) run->progress.Step(true);
  tasks.Run();
  return writer.cloud_size();
}

}  // namespace acmp
