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

/// Tells how far the run is: steps of the schedule, files of images, points of images.
/// @param steps,files that are to do
void BeginResults(const ReconstructRun& run, size_t images, size_t steps, size_t files) {
  constexpr double kShareBeforeMesh = 0.9;
  std::optional<double> share;
  if (!run.options.mesh.empty()) share = kShareBeforeMesh * (1 - run.progress.done_share());
  const bool offline = !run.options.online();
  const size_t all_steps = offline ? images * static_cast<size_t>(run.store.final_step() + 1) : 0;
  run.progress.Begin(offline ? "depth maps, pictures and cloud" : "maps, pictures and cloud",
                     static_cast<int>(all_steps + files + images), share);
  for (size_t reused = steps; reused < all_steps; ++reused) run.progress.Step(true);
}

size_t BytesOf(const PointCloud& points) { return points.size() * sizeof(SurfacePoint); }

/// Takes a view's points out of its work file.
PointCloud TakePoints(const std::filesystem::path& file) {
  std::optional<PointCloud> points = ReadPoints(file);
  if (!points) throw ProcessingError(Concat("cannot read the points in ", file.string()));
  std::error_code ignored;  // what is left goes with the work folder
  std::filesystem::remove(file, ignored);
  return std::move(*points);
}

/// Adds the fusion of these images. Points wait until those of all images before are handed out: in files if there is
/// no room in memory, so that a scene of any size can be fused. Returns the number of the last task.
/// @param images at least one
/// @param take gets the points of one image after the other
int AddFusions(ReconstructRun* run, const std::set<int>& images, MemoryRoom* room, RunTasks* tasks,
               const std::function<void(PointCloud)>& take) {
  std::vector<int> after;
  for (int index : images) {
    const std::filesystem::path file = run->folder->WorkFile("points", index);
    const auto waiting = std::make_shared<std::optional<PointCloud>>();
    after.push_back(tasks->AddFusion(*run->plan.Find(index), [room, file, waiting](PointCloud points) {
      if (room->Take(BytesOf(points))) {
        *waiting = std::move(points);
      } else {
        WritePoints(file, points);
      }
    }));
    const auto hand_out = [room, file, waiting, take] {
      if (!*waiting) return take(TakePoints(file));
      const size_t bytes = BytesOf(**waiting);
      take(std::move(**waiting));
      room->GiveBack(bytes);
    };
    after = {tasks->AddFileTask(after, hand_out, true)};
  }
  return after.front();
}

}  // namespace

ImageFiles::ImageFiles(ReconstructRun* run)
    : run_(*run),
      writes_any_(run->options.colmap || !run->options.maps.empty()),
      room_(run->devices.on_host() ? 0 : run->options.MemoryBytes(run->options.kMapShare)) {
  for (const std::string& kind : run_.options.maps) MakeFolder(run_.folder->path() / kind);
  if (!run_.options.no_pictures && !run_.options.maps.empty()) MakeFolder(run_.folder->path() / "pictures");
  if (run_.options.colmap) colmap_.emplace(run);
}

/// The files that are made of an image, with how. @param too_far pixels that are too deep for depth/*.png
std::vector<ImageFiles::File> ImageFiles::FilesOf(int index, const FinalMaps& maps, size_t* too_far) const {
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

/// "none" for a file that is missing.
std::string ImageFiles::ChecksumsOf(int index) const {
  std::string checksums;
  for (const File& file : FilesOf(index, {}, nullptr)) {
    const std::optional<uint32_t> checksum = ChecksumOfFile(file.path);
    checksums += checksum ? Concat(*checksum, " ") : "none ";
  }
  return checksums;
}

std::set<int> ImageFiles::Missing(const std::set<int>& images) const {
  std::set<int> missing;
  if (!writes_any_) return missing;
  for (int index : images) {
    if (ReadWorkFile(RecordOf(index)) != ChecksumsOf(index)) missing.insert(index);
  }
  return missing;
}

void ImageFiles::AddTasks(const ImagePlan& image, RunTasks* tasks) {
  const int index = image.index;
  if (run_.options.online()) {
    tasks->AddFileTask({}, [=] {
      WriteFiles(index, ReadFinalMaps(run_.store.FileOf({run_.store.final_step(), index})));
    });
    return;
  }
  const PinholeCamera camera = CameraOf(run_, index);
  const size_t bytes = static_cast<size_t>(camera.width) * camera.height * (3 * sizeof(float) + sizeof(Vec3f));
  const auto waiting = std::make_shared<std::optional<FinalMaps>>();
  const int fetched = tasks->AddMaps(image, Writes(run_.options, "confidence"), [=](FinalMaps maps) {
    if (room_.Take(bytes)) {
      *waiting = std::move(maps);
    } else {
      WriteFiles(index, maps);
    }
  });
  tasks->AddFileTask({fetched}, [=] {
    if (!*waiting) return;
    WriteFiles(index, **waiting);
    waiting->reset();
    room_.GiveBack(bytes);
  });
}

void ImageFiles::WriteFiles(int index, const FinalMaps& maps) {
  Timer timer;
  size_t too_far = 0;
  // Side by side: compressing pictures takes longer than writing them.
  tbb::parallel_for_each(FilesOf(index, maps, &too_far), [](const File& file) {
    file.write(file.path);
    StartWriteback(file.path);
  });
  if (colmap_) colmap_->WriteMaps(index, maps);
  run_.Count(&RunTimes::writing_ms, timer.Lap());
  run_.interrupt.Check();
  if (!run_.options.stage.empty()) WriteWorkFile(RecordOf(index), ChecksumsOf(index));
  run_.progress.Step();
  const std::lock_guard<std::mutex> lock(run_.mutex);
  too_far_ += too_far;
}

void ImageFiles::WarnOfDepthsTooFar() const {
  if (too_far_ == 0) return;
  run_.progress.Warn(
      Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
}

PinholeCamera CameraOf(const ReconstructRun& run, int index) {
  return MatchedCamera(run.scene.images[static_cast<size_t>(index)], run.options);
}

void WriteCameras(const ReconstructRun& run, const std::set<int>& images) {
  std::vector<ListedCamera> cameras;
  for (int index : images) {
    const SceneImage& image = run.scene.images[static_cast<size_t>(index)];
    cameras.push_back({{index, image.name}, CameraOf(run, index), WrittenPose(image)});
  }
  WriteCameraList(run.folder->path() / "cameras.txt", cameras);
}

CloudSize RunAndWriteResults(ReconstructRun* run) {
  const std::set<int> images = run->plan.WithMap();
  RunTasks tasks(run, run->options.online() ? -1 : run->store.final_step(), images);
  ImageFiles files(run);
  const std::set<int> missing_files = files.Missing(images);
  for (int index : missing_files) files.AddTasks(*run->plan.Find(index), &tasks);
  std::optional<TiledCloud> tiles;  // where the points go: into these, or into the file
  std::optional<PlyFile> file;
  if (run->options.tile_size) {
    const size_t bytes = run->options.MemoryBytes(run->options.kTileShare);
    tiles.emplace(run->folder, *run->options.tile_size, bytes, run->plan.origin);
  } else {
    file.emplace(run->folder->path() / "fused.ply", Durability::kPowerCut, run->plan.origin);
  }
  std::vector<PointCloud> clouds;  // for COLMAP's model; else none
  MemoryRoom room(run->options.MemoryBytes(run->options.kPointShare));
  const int all = AddFusions(run, images, &room, &tasks, [&](PointCloud points) {
    Timer timer;
    if (tiles) {
      tiles->Add(points);
    } else {
      file->Append(points);
    }
    if (files.colmap()) clouds.push_back(std::move(points));
    run->Count(&RunTimes::cloud_ms, timer.Lap());
  });
  tasks.AddFileTask({all}, [&] {
    Timer timer;
    if (tiles) {
      tiles->Commit(run->interrupt);
    } else {
      file->Commit();
    }
    run->Count(&RunTimes::cloud_ms, timer.Lap());
  });
  BeginResults(*run, images.size(), tasks.steps(), missing_files.size());
  tasks.Run();
  run->interrupt.Check();
  files.WarnOfDepthsTooFar();
  WriteCameras(*run, images);
  if (files.colmap()) files.colmap()->WriteModel(images, clouds);
  if (tiles) return {tiles->points(), tiles->tiles()};
  return {file->points(), std::nullopt};
}

void RunStage(ReconstructRun* run, int step, const std::set<int>& images, bool maps) {
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
  run->progress.Begin(run->options.stage, static_cast<int>(tasks.steps() + missing_files.size()));
  tasks.Run();
  if (files) files->WarnOfDepthsTooFar();
}

}  // namespace acmp
