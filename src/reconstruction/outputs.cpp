#include "outputs.h"

#include <tbb/parallel_for_each.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/output_file.h"
#include "run_tasks.h"
#include "work_files.h"

namespace acmp {
namespace {

bool Writes(const ReconstructOptions& options, const std::string& kind) {
  return std::find(options.maps.begin(), options.maps.end(), kind) != options.maps.end();
}

/// The files of images with final estimates: maps, their pictures, and their part of COLMAP's workspace. A stage leaves
/// a record of each image whose files it has written, and none that has one is written again.
class ImageFiles {
 public:
  /// Claims the files and makes the folders. @param run not null, with a folder; outlives this
  explicit ImageFiles(ReconstructRun* run)
      : run_(*run),
        writes_any_(run->options.colmap || !run->options.maps.empty()),
        room_(run->devices.on_host() ? 0 : static_cast<int64_t>(run->options.MemoryBytes(run->options.kMapShare))) {
    std::set<std::string> names = run_.options.colmap ? ColmapFilesOf(run_) : std::set<std::string>();
    for (int index : run_.plan.WithMap()) {
      for (const File& file : FilesOf(index, {}, nullptr)) {
        names.insert(file.path.lexically_relative(run_.folder->path()).string());
      }
    }
    names.insert({"cameras.txt", "fused.ply"});
    run_.folder->Claim(names);
    for (const std::string& kind : run_.options.maps) MakeFolder(run_.folder->path() / kind);
    if (!run_.options.no_pictures && !run_.options.maps.empty()) MakeFolder(run_.folder->path() / "pictures");
  }

  /// Of these images with a map those with files that are not there as a stage has recorded them.
  std::set<int> Missing(const std::set<int>& images) const {
    std::set<int> missing;
    if (!writes_any_) return missing;
    for (int index : images) {
      if (ReadWorkFile(RecordOf(index)) != ChecksumsOfFiles(index)) missing.insert(index);
    }
    return missing;
  }

  /// Adds the tasks that fetch an image's maps and write its files. Where maps wait for the threads that write files
  /// until there is no memory for more, those that fetch them write, too; on the host they always do.
  void AddTasks(const ImagePlan& image, RunTasks* tasks) {
    const int index = image.index;
    if (run_.options.online()) {
      tasks->AddFileTask({}, [=] {
        WriteFiles(index, ReadFinalMaps(run_.store.FileOf({run_.store.final_step(), index})));
      });
      return;
    }
    const PinholeCamera camera = CameraOf(run_, index);
    const int64_t bytes = int64_t{camera.width} * camera.height * int64_t{3 * sizeof(float) + sizeof(Vec3f)};
    const auto waiting = std::make_shared<std::optional<FinalMaps>>();
    const int fetched = tasks->AddMaps(image, Writes(run_.options, "confidence"), [=](FinalMaps maps) {
      if ((room_ -= bytes) >= 0) {
        *waiting = std::move(maps);
      } else {
        room_ += bytes;
        WriteFiles(index, maps);
      }
    });
    tasks->AddFileTask({fetched}, [=] {
      if (!*waiting) return;
      WriteFiles(index, **waiting);
      waiting->reset();
      room_ += bytes;
    });
  }

  /// At the end: what the files could not hold.
  void WarnOfDepthsTooFar() const {
    if (too_far_ == 0) return;
    run_.progress.Warn(
        Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
  }

 private:
  using Path = std::filesystem::path;
  struct File {
    Path path;
    std::function<void(const Path&)> write;
  };

  Path RecordOf(int index) const { return run_.folder->WorkFile("maps", index); }

  /// The files that are made of an image, with how. @param too_far pixels that are too deep for depth/*.png
  std::vector<File> FilesOf(int index, const FinalMaps& maps, size_t* too_far) const {
    std::vector<File> files;
    const auto add = [&](const std::string& kind, const std::string& suffix, std::function<void(const Path&)> write) {
      files.push_back({run_.folder->MapFile(kind, index, suffix), std::move(write)});
    };
    const auto add_map = [&](const std::string& kind, const auto& map, const auto& make_picture) {
      if (!Writes(run_.options, kind)) return;
      add(kind, ".pfm", [&map](const Path& path) { WritePfm(path, map.View()); });
      if (run_.options.no_pictures) return;
      add("pictures", "_" + kind + ".png",
          [&map, make_picture](const Path& path) { WritePng(path, make_picture(map.View())); });
    };
    add_map("depth", maps.depth, DepthPicture);
    add_map("normal", maps.normal, NormalPicture);
    add_map("cost", maps.cost, CostPicture);
    add_map("confidence", maps.confidence, ConfidencePicture);
    if (Writes(run_.options, "depth")) {
      add("depth", ".png", [&maps, too_far](const Path& path) { *too_far = WriteDepthPng(path, maps.depth.View()); });
    }
    if (run_.options.dmb) add("depth", ".dmb", [&maps](const Path& path) { WriteDmb(path, maps.depth.View()); });
    return files;
  }

  std::string ChecksumsOfFiles(int index) const {
    std::vector<Path> paths;
    for (const File& file : FilesOf(index, {}, nullptr)) paths.push_back(file.path);
    return ChecksumsOf(paths);
  }

  void WriteFiles(int index, const FinalMaps& maps) {
    size_t too_far = 0;
    // Side by side: compressing pictures takes longer than writing them.
    tbb::parallel_for_each(FilesOf(index, maps, &too_far), [](const File& file) { file.write(file.path); });
    if (run_.options.colmap) WriteColmapMaps(run_, index, maps);
    run_.interrupt.Check();
    if (run_.options.stages) WriteWorkFile(RecordOf(index), ChecksumsOfFiles(index));
    run_.progress.Step();
    const std::lock_guard<std::mutex> lock(run_.mutex);
    too_far_ += too_far;
  }

  ReconstructRun& run_;
  const bool writes_any_;
  std::atomic<int64_t> room_;  ///< bytes that are left for maps that wait
  size_t too_far_ = 0;         ///< pixels; under the run's mutex while tasks run
};

/// Writes OUTPUT/cameras.txt: cameras of the maps, at their size, with their poses.
/// @param images with maps, by scene index
void WriteCamerasOf(const ReconstructRun& run, const std::set<int>& images) {
  std::vector<ListedCamera> cameras;
  for (int index : images) {
    const SceneImage& image = run.scene.images[static_cast<size_t>(index)];
    cameras.push_back({{index, image.name}, CameraOf(run, index), WrittenPose(image)});
  }
  WriteCameraList(run.folder->path() / "cameras.txt", cameras);
}

/// Tells how far the run is: steps of the schedule, files of images, points of images.
/// @param steps,files that are to do
void BeginResults(const ReconstructRun& run, size_t images, size_t steps, size_t files) {
  const bool offline = !run.options.online();
  const size_t all_steps = offline ? images * static_cast<size_t>(run.store.final_step() + 1) : 0;
  run.progress.Begin(offline ? "depth maps, pictures and cloud" : "maps, pictures and cloud",
                     static_cast<int>(all_steps + files + images), static_cast<int>(all_steps - steps));
}

/// Adds the fusion of these images. So that points that wait for those of earlier images fit into their share of
/// memory, a view is fused when those of the one so many before it have been handed out. Returns the number of the last
/// task.
/// @param images at least one
/// @param take gets the points of one image after the other
int AddFusions(ReconstructRun* run, const std::set<int>& images, RunTasks* tasks,
               const std::function<void(PointCloud)>& take) {
  size_t most_points = 1;  // of an image: one for each pixel
  for (int index : images) {
    const PinholeCamera camera = CameraOf(*run, index);
    most_points = std::max(most_points, static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height));
  }
  const size_t room = run->options.MemoryBytes(run->options.kPointShare) / (most_points * sizeof(SurfacePoint));
  std::vector<int> handed_out;  // tasks
  for (int index : images) {
    const auto waiting = std::make_shared<PointCloud>();
    std::vector<int> after;
    if (handed_out.size() > room) after.push_back(handed_out[handed_out.size() - 1 - room]);
    const auto keep = [waiting](PointCloud points) { *waiting = std::move(points); };
    after = {tasks->AddFusion(*run->plan.Find(index), after, keep)};
    if (!handed_out.empty()) after.push_back(handed_out.back());
    handed_out.push_back(tasks->AddFileTask(
        after, [waiting, take] { take(std::move(*waiting)); }, true));
  }
  return handed_out.back();
}

}  // namespace

PinholeCamera CameraOf(const ReconstructRun& run, int index) {
  return MatchedCamera(run.scene.images[static_cast<size_t>(index)], run.options);
}

size_t RunAndWriteResults(ReconstructRun* run) {
  const std::set<int> images = run->plan.WithMap();
  RunTasks tasks(run, run->options.online() ? -1 : run->store.final_step(), images);
  ImageFiles files(run);
  const std::set<int> missing_files = files.Missing(images);
  for (int index : missing_files) files.AddTasks(*run->plan.Find(index), &tasks);
  PlyFile file(run->folder->path() / "fused.ply", Durability::kPowerCut, run->plan.origin);
  std::vector<PointCloud> clouds;  // for COLMAP's model; else none
  const int all = AddFusions(run, images, &tasks, [&](PointCloud points) {
    file.Append(points);
    if (run->options.colmap) clouds.push_back(std::move(points));
  });
  tasks.AddFileTask({all}, [&] { file.Commit(); });
  BeginResults(*run, images.size(), tasks.steps(), missing_files.size());
  tasks.Run();
  run->interrupt.Check();
  files.WarnOfDepthsTooFar();
  WriteCamerasOf(*run, images);
  if (run->options.colmap) WriteColmapWorkspace(*run, images, clouds);
  return file.points();
}

void RunStage(ReconstructRun* run, const std::string& name, int step, const std::set<int>& images, bool maps) {
  std::set<int> missing_files, read = images;
  std::optional<ImageFiles> files;
  if (maps) {
    files.emplace(run);
    missing_files = files->Missing(images);
    read.clear();
    for (int index : missing_files) {
      for (int other : run->plan.ImagesRead(*run->plan.Find(index))) read.insert(other);
    }
  }
  RunTasks tasks(run, step, read);
  for (int index : missing_files) files->AddTasks(*run->plan.Find(index), &tasks);
  run->progress.Begin(name, static_cast<int>(tasks.steps() + missing_files.size()));
  tasks.Run();
  if (files) files->WarnOfDepthsTooFar();
}

}  // namespace acmp
