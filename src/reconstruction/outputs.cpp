#include "outputs.h"

#include <tbb/parallel_for_each.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/output_file.h"
#include "work_files.h"

namespace acmp {
namespace {

bool Writes(const ReconstructOptions& options, const std::string& kind) {
  return std::find(options.maps.begin(), options.maps.end(), kind) != options.maps.end();
}

constexpr int kStepsPerImage = 2;  // of the progress: files and fusion

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

std::vector<std::filesystem::path> FilesOfImage(const ReconstructOptions& options, const OutputFolder& folder,
                                                int index) {
  std::vector<std::filesystem::path> files;
  for (const std::string& kind : options.maps) {
    files.push_back(folder.MapFile(kind, index, ".pfm"));
    if (!options.no_pictures) files.push_back(folder.MapFile("pictures", index, "_" + kind + ".png"));
  }
  if (Writes(options, "depth")) files.push_back(folder.MapFile("depth", index, ".png"));
  if (options.dmb) files.push_back(folder.MapFile("depth", index, ".dmb"));
  return files;
}

ImageFiles::ImageFiles(ReconstructRun* run)
    : run_(*run),
      measures_confidence_(Writes(run->options, "confidence") &&
                           !run->options.online()) {  // online maps come with theirs
  for (const std::string& kind : run_.options.maps) MakeFolder(run_.folder->path() / kind);
  if (!run_.options.no_pictures && !run_.options.maps.empty()) MakeFolder(run_.folder->path() / "pictures");
  if (run_.options.colmap) colmap_.emplace(run);
}

int ImageFiles::AddTasks(const ImagePlan& image, RunTasks* tasks) {
  const auto confidence = std::make_shared<ConfidenceMap>();
  std::vector<int> after = tasks->FinalStepsRead(image);
  if (measures_confidence_) {
    after = {tasks->AddConfidence(image, [confidence](ConfidenceMap measured) { *confidence = std::move(measured); })};
  }
  return tasks->AddFileTask(after, [this, index = image.index, confidence] { WriteFiles(index, *confidence); });
}

void ImageFiles::WriteFiles(int index, const ConfidenceMap& measured) {
  if (colmap_ || !run_.options.maps.empty()) {
    const std::shared_ptr<const FinalMaps> maps = run_.store.Final(index);
    Timer timer;
    const size_t too_far = Write(index, *maps, measures_confidence_ ? measured : maps->confidence);
    run_.Count(&RunTimes::writing_ms, timer.Lap());
    const std::lock_guard<std::mutex> lock(run_.mutex);
    too_far_ += too_far;
  }
  run_.store.ReleaseFinal(index);
  run_.progress.Step();
}

void ImageFiles::WarnOfDepthsTooFar() const {
  if (too_far_ == 0) return;
  run_.progress.Warn(
      Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
}

size_t ImageFiles::Write(int index, const FinalMaps& maps, const ConfidenceMap& confidence) const {
  size_t too_far = 0;
  std::vector<std::function<void()>> files;
  const auto add = [&](const std::string& kind, const std::string& suffix, const auto& write) {
    files.emplace_back([path = run_.folder->MapFile(kind, index, suffix), write] {
      write(path);
      StartWriteback(path);
    });
  };
  const auto add_map = [&](const std::string& kind, const auto& map, const auto& make_picture) {
    if (!Writes(run_.options, kind)) return;
    add(kind, ".pfm", [&map](const auto& path) { WritePfm(path, map.View()); });
    if (run_.options.no_pictures) return;
    add("pictures", "_" + kind + ".png",
        [&map, make_picture](const auto& path) { WritePng(path, make_picture(map.View())); });
  };
  add_map("depth", maps.depth, DepthPicture);
  add_map("normal", maps.normal, NormalPicture);
  add_map("cost", maps.cost, CostPicture);
  add_map("confidence", confidence, ConfidencePicture);
  if (Writes(run_.options, "depth")) {
    add("depth", ".png", [&](const auto& path) { too_far = WriteDepthPng(path, maps.depth.View()); });
  }
  if (run_.options.dmb) add("depth", ".dmb", [&](const auto& path) { WriteDmb(path, maps.depth.View()); });
  if (colmap_) files.emplace_back([&] { colmap_->WriteMaps(index, maps); });
  // Side by side: compressing pictures takes longer than writing them.
  tbb::parallel_for_each(files, [](const std::function<void()>& write) { write(); });
  return too_far;
}

CloudOutput::CloudOutput(const ReconstructRun& run) : interrupt_(run.interrupt) {
  if (run.options.tile_size) {
    tiles_.emplace(run.folder, *run.options.tile_size, run.options.MemoryBytes(run.options.kTileShare),
                   run.plan.origin);
  } else {
    file_.emplace(run.folder->path() / "fused.ply", Durability::kPowerCut, run.plan.origin);
  }
}

void CloudOutput::Add(const PointCloud& points) {
  if (tiles_) return tiles_->Add(points);
  file_->WriteAt(file_->Reserve(points.size()), points);
}

void CloudOutput::Commit() {
  if (tiles_) return tiles_->Commit(interrupt_);
  file_->Commit();
}

CloudSize CloudOutput::size() const {
  if (tiles_) return {tiles_->points(), tiles_->tiles()};
  return {file_->points(), std::nullopt};
}

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
