#include <oneapi/tbb/parallel_invoke.h>

#include <Eigen/Geometry>
#include <iomanip>
#include <map>
#include <sstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
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

class ResultWriter {
 public:
  explicit ResultWriter(ReconstructRun* run) : run_(*run) {
    for (const ImagePlan& image : run_.plan.images) {
      if (image.no_map.empty()) maps_.emplace(image.index, run_.folder.WorkFile("final", image.index));
    }
    for (const char* kind : {"depth", "normal", "cost", "confidence"}) MakeFolder(run_.folder.path() / kind);
    run_.folder.MakeWorkFolder(kWrittenMark);
    if (!run_.options.no_pictures) MakeFolder(run_.folder.path() / "pictures");
  }

  size_t Write() {
    run_.progress.Begin("maps and pictures", static_cast<int>(maps_.size()), StepCosts::kOutput);
    for (const auto& [index, maps] : maps_) {
      run_.interrupt.Check();
      const bool done = std::filesystem::exists(run_.folder.WorkFile(kWrittenMark, index)) && AllFilesExist(index);
      if (!done) {
        WriteImage(index, maps);
        unmarked_.push_back(index);
      }
      run_.progress.Step(done);
      if (unmarked_.size() >= kImagesPerSync) MarkWritten();
    }
    MarkWritten();
    if (too_far_ > 0) {
      run_.progress.Warn(
          Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
    }
    WriteCameras();
    return WriteCloud();
  }

 private:
  FusionView ViewOf(int index) const {
    const MappedFinalMaps& maps = maps_.at(index);
    FusionView view;
    view.camera = CameraOf(run_.scene, index, run_.options.max_image_size);
    view.cam_from_world = run_.scene.images[index].cam_from_world;
    view.depth = maps.depth();
    view.normal = maps.normal();
    view.cost = maps.cost();
    view.color = maps.color();
    return view;
  }

  std::vector<std::filesystem::path> FilesOf(int index) const {
    const ReconstructFolder& folder = run_.folder;
    std::vector<std::filesystem::path> files = {
        folder.MapFile("depth", index, ".pfm"), folder.MapFile("depth", index, ".png"),
        folder.MapFile("normal", index, ".pfm"), folder.MapFile("cost", index, ".pfm"),
        folder.MapFile("confidence", index, ".pfm")};
    if (run_.options.dmb) files.push_back(folder.MapFile("depth", index, ".dmb"));
    if (run_.options.no_pictures) return files;
    for (const char* suffix : {"_depth.png", "_normal.png", "_cost.png", "_confidence.png"}) {
      files.push_back(folder.MapFile("pictures", index, suffix));
    }
    return files;
  }

  /// A mark says that an image's files are on the disk for good.
  void MarkWritten() {
    SyncFolder(run_.folder.path());
    for (int index : unmarked_) WriteFileAtomically(run_.folder.WorkFile(kWrittenMark, index), "");
    unmarked_.clear();
  }

  bool AllFilesExist(int index) const {
    for (const auto& file : FilesOf(index)) {
      if (!std::filesystem::exists(file)) return false;
    }
    return true;
  }

  ConfidenceMap ConfidenceOf(int index, const MappedFinalMaps& maps) {
    if (!maps.confidence().empty()) return Copy(maps.confidence());
    std::vector<FusionView> sources;
    for (int source : maps.sources()) {
      if (maps_.count(source) > 0) sources.push_back(ViewOf(source));
    }
    Timer timer;
    ConsistencyResult result = FilterByConsistency(ViewOf(index), sources, MakePipelineOptions(run_.options).fusion);
    run_.interrupt.Check();
    run_.times.consistency_ms += timer.Lap();
    return std::move(result.confidence);
  }

  void WriteImage(int index, const MappedFinalMaps& maps) {
    const ConfidenceMap confidence = ConfidenceOf(index, maps);
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
        });
    too_far_ += too_far;
    run_.times.io_ms += timer.Lap();
  }

  void WriteCameras() const {
    std::ostringstream text;
    text
        << "# cameras of the maps (image plane: x right, y down, pixel centres at integer coordinates, no distortion)\n"
           "# columns: index filename fx fy cx cy width height qw qx qy qz tx ty tz\n"
           "# qw..tz is T_world_cam (camera -> world): X_world = R(q) * X_cam + t; camera axes x right, y down, z "
           "forward\n"
        << std::setprecision(15);
    for (const auto& [index, maps] : maps_) {
      const PinholeCamera c = CameraOf(run_.scene, index, run_.options.max_image_size);
      const RigidTransform world_from_cam = run_.scene.images[index].cam_from_world.inverse();
      const Eigen::Quaterniond q(world_from_cam.linear());
      const Eigen::Vector3d t = world_from_cam.translation();
      text << index << ' ' << run_.scene.images[index].name << ' ' << c.fx << ' ' << c.fy << ' ' << c.cx << ' ' << c.cy
           << ' ' << c.width << ' ' << c.height << ' ' << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' '
           << t.x() << ' ' << t.y() << ' ' << t.z() << '\n';
    }
    WriteFileAtomically(run_.folder.path() / "cameras.txt", text.str());
  }

  size_t WriteCloud() {
    run_.progress.Begin("point cloud", 1, StepCosts::kFusion * static_cast<double>(maps_.size()));
    std::map<int, int> position_of_index;
    std::vector<FusionView> views;
    for (const auto& [index, maps] : maps_) {
      position_of_index[index] = static_cast<int>(views.size());
      views.push_back(ViewOf(index));
    }
    std::vector<std::vector<int>> neighbors;
    for (const auto& [index, maps] : maps_) {
      neighbors.emplace_back();
      for (int source : maps.sources()) {
        const auto found = position_of_index.find(source);
        if (found != position_of_index.end()) neighbors.back().push_back(found->second);
      }
    }
    Timer timer;
    const PointCloud points = FuseDepthMaps(views, neighbors, MakePipelineOptions(run_.options).fusion);
    run_.times.fusion_ms += timer.Lap();
    run_.interrupt.Check();
    WritePly(run_.folder.path() / "fused.ply", points);
    run_.times.io_ms += timer.Lap();
    run_.progress.Step();
    return points.size();
  }

  ReconstructRun& run_;
  std::map<int, MappedFinalMaps> maps_;  ///< by scene index
  std::vector<int> unmarked_;
  size_t too_far_ = 0;
};

}  // namespace

size_t WriteResults(ReconstructRun* run) { return ResultWriter(run).Write(); }

}  // namespace acmp
