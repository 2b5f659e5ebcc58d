#include <map>
#include <optional>
#include <set>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/map_io.h"
#include "cloud_output.h"
#include "image_files.h"
#include "work_files.h"

namespace acmp {
namespace {

constexpr int kStepsPerImage = 2;  ///< of the progress: files and fusion

/// Tells how far the run is. @param steps of the schedule that are to do
void BeginResults(const ReconstructRun& run, size_t images, size_t steps) {
  constexpr double kShareBeforeMesh = 0.9;
  std::optional<double> share;
  if (!run.options.mesh.empty()) share = kShareBeforeMesh * (1 - run.progress.done_share());
  const bool offline = !run.options.online();
  const size_t all_steps = offline ? images * static_cast<size_t>(run.store.final_step() + 1) : 0;
  run.progress.Begin(offline ? "depth maps, pictures and cloud" : "maps, pictures and cloud",
                     static_cast<int>(all_steps + images * kStepsPerImage), share);
  for (size_t reused = steps; reused < all_steps; ++reused) run.progress.Step(true);
}

/// Takes a view's points out of its work file.
PointCloud TakePoints(const std::filesystem::path& file) {
  std::optional<PointCloud> points = ReadPoints(file);
  if (!points) throw ProcessingError(Concat("cannot read the points in ", file.string()));
  std::error_code ignored;  // what is left goes with the work folder
  std::filesystem::remove(file, ignored);
  return std::move(*points);
}

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
    cameras.push_back({{index, image.name}, CameraOf(run, index), image.cam_from_world.inverse()});
  }
  WriteCameraList(run.folder->path() / "cameras.txt", cameras);
}

CloudSize RunAndWriteResults(ReconstructRun* run) {
  RunTasks tasks(run);
  size_t steps = 0;
  if (!run->options.online()) steps = tasks.AddMissingSteps().size();
  ImageFiles files(run);
  CloudOutput cloud(*run);
  std::vector<int> images;         // with maps, by scene index: in the order of the cloud
  std::vector<PointCloud> clouds;  // theirs, for COLMAP's model; else none
  std::vector<int> all_written, in_cloud;
  for (const ImagePlan& image : run->plan.images) {
    if (!image.no_map.empty()) continue;
    images.push_back(image.index);
    all_written.push_back(files.AddTasks(image, &tasks));
    const std::filesystem::path file = run->folder->WorkFile("points", image.index);
    // Points wait in files, so that a scene of any size can be fused, until those of all images before are written.
    in_cloud.push_back(tasks.AddFusion(image, [file](const PointCloud& points) { WritePoints(file, points); }));
    in_cloud = {tasks.AddFileTask(
        in_cloud,
        [&, file] {
          Timer timer;
          PointCloud points = TakePoints(file);
          cloud.Add(points);
          if (files.colmap()) clouds.push_back(std::move(points));
          run->Count(&RunTimes::cloud_ms, timer.Lap());
        },
        true)};
  }
  tasks.AddFileTask(all_written, [&] {
    files.WarnOfDepthsTooFar();
    WriteCameras(*run, images);
  });
  if (files.colmap()) in_cloud.insert(in_cloud.end(), all_written.begin(), all_written.end());  // its model reads maps
  tasks.AddFileTask(in_cloud, [&] {
    Timer timer;
    cloud.Commit();
    run->Count(&RunTimes::cloud_ms, timer.Lap());
    if (files.colmap()) files.colmap()->WriteModel(images, clouds);
  });
  BeginResults(*run, images.size(), steps);
  tasks.Run();
  return cloud.size();
}

}  // namespace acmp
