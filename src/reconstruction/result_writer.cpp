#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/camera_list.h"
#include "cloud_output.h"
#include "map_writer.h"
#include "run.h"
#include "view_outputs.h"
#include "waiting_clouds.h"

namespace acmp {
namespace {

/// The output steps of a run. Confidences and points are made on the engines, files by other threads.
class ResultWriter {
 public:
  explicit ResultWriter(ReconstructRun* run)
      : run_(*run),
        maps_(run),
        waiting_(&run->folder, run->options.CloudBytes()),
        cloud_(run->options, &run->folder, run->plan.origin),
        fusion_(run) {}

  void AddTasks(const std::map<int, int>& final_maps, TaskGraph* graph) {
    std::vector<int> all_written, all_in_cloud;
    std::vector<int> last_placed;  // or none
    for (const ImagePlan& image : run_.plan.images) {
      if (!image.no_map.empty()) continue;
      const std::vector<int> maps = TasksOfMapsRead(run_.plan, image, final_maps);
      all_written.push_back(maps_.AddTasks(image, maps, graph));
      const int fused = fusion_.AddTask(
          image, maps, graph, [this, index = image.index](PointCloud cloud) { waiting_.Put(index, std::move(cloud)); });
      const size_t rank = images_.size();
      last_placed.push_back(fused);
      last_placed = {graph->Add(
          Devices::kFilePool, last_placed, [this, rank](int) { Place(rank); }, true)};
      all_in_cloud.push_back(
          cloud_.in_order() ? last_placed.back()
                            : graph->Add(Devices::kFilePool, last_placed, [this, rank](int) { WritePoints(rank); }));
      images_.push_back(image.index);
    }
    places_.resize(images_.size());
    clouds_.resize(maps_.colmap() ? images_.size() : 0);
    graph->Add(Devices::kFilePool, all_written, [this](int) { FinishFiles(); });
    graph->Add(Devices::kFilePool, all_in_cloud, [this](int) { FinishCloud(); });
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
    if (maps_.colmap()) clouds_[rank] = std::move(cloud);
    const std::lock_guard<std::mutex> lock(run_.times_mutex);
    run_.times.cloud_ms += timer.Lap();
  }

  void FinishFiles() {
    maps_.WarnOfDepthsTooFar();
    WriteCameraList(run_.folder.path() / "cameras.txt", Cameras(run_, images_));
  }

  void FinishCloud() {
    Timer timer;
    cloud_.Commit(run_.interrupt);
    {
      const std::lock_guard<std::mutex> lock(run_.times_mutex);
      run_.times.cloud_ms += timer.Lap();
    }
    if (maps_.colmap()) maps_.colmap()->WriteModel(images_, clouds_);
  }

  ReconstructRun& run_;
  MapWriter maps_;
  WaitingClouds waiting_;
  CloudOutput cloud_;
  ViewFusion fusion_;
  std::vector<int> images_;         ///< with maps, by scene index: in the order of the cloud
  std::vector<size_t> places_;      ///< of the views' first points in the cloud
  std::vector<PointCloud> clouds_;  ///< the views', for COLMAP's model; else none
};

}  // namespace

PinholeCamera CameraOf(const ScheduleRun& run, int index) {
  const PinholeCamera& camera = run.scene.images[index].camera;
  int width = camera.width;
  int height = camera.height;
  LimitSize(run.options.max_image_size, &width, &height);
  return camera.Resized(width, height);
}

std::vector<ListedCamera> Cameras(const ReconstructRun& run, const std::vector<int>& images) {
  std::vector<ListedCamera> cameras;
  for (int index : images) {
    const SceneImage& image = run.scene.images[index];
    cameras.push_back({{index, image.name}, CameraOf(run, index), image.cam_from_world.inverse()});
  }
  return cameras;
}

CloudSize RunAndWriteResults(ReconstructRun* run, const std::map<int, int>& final_maps, TaskGraph* graph) {
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
  return writer.cloud_size();
}

}  // namespace acmp
