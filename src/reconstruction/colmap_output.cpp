#include <algorithm>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/voxel_map.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "outputs.h"

namespace acmp {
namespace {

constexpr double kVoxelShare = 0.005;  // of the median depth, as in the online map

/// One point per voxel of all clouds; empty where they are.
PointCloud ThinnedClouds(const std::vector<PointCloud>& clouds, const std::vector<ColmapModelImage>& images) {
  std::vector<double> depths;
  std::vector<PlacedCloud<PointCloud>> placed;
  for (size_t i = 0; i < clouds.size(); ++i) {
    if (clouds[i].empty()) continue;
    std::vector<double> of_image(clouds[i].size());
    std::transform(clouds[i].begin(), clouds[i].end(), of_image.begin(), [&](const SurfacePoint& point) {
      return (images[i].cam_from_world * InWorld(Eigen::Vector3d::Zero(), point.position)).z();
    });
    depths.push_back(Median(std::move(of_image)));
    placed.push_back({RigidTransform::Identity(), &clouds[i]});
  }
  return placed.empty() ? PointCloud() : MergeClouds(placed, static_cast<float>(kVoxelShare * Median(depths)));
}

std::filesystem::path WorkspaceOf(const ReconstructRun& run) { return run.folder->path() / "colmap"; }

std::filesystem::path DepthFileOf(const ReconstructRun& run, const std::string& name) {
  return WorkspaceOf(run) / "stereo/depth_maps" / (name + ".geometric.bin");
}

}  // namespace

std::set<std::string> ColmapFilesOf(const ReconstructRun& run) {
  std::set<std::string> names = {"colmap/stereo/fusion.cfg", "colmap/stereo/patch-match.cfg", "colmap/origin.txt"};
  for (const std::string& name : ColmapModelFiles()) names.insert("colmap/" + name);
  for (int index : run.plan.WithMap()) {
    const std::string& name = run.scene.images[index].name;
    names.insert({"colmap/images/" + name, "colmap/stereo/depth_maps/" + name + ".geometric.bin",
                  "colmap/stereo/normal_maps/" + name + ".geometric.bin"});
  }
  return names;
}

void WriteColmapMaps(const ReconstructRun& run, int index, const FinalMaps& maps) {
  DepthMap measured_depth = maps.depth.Clone();
  NormalMap measured_normal = maps.normal.Clone();
  for (size_t i = 0; i < measured_depth.size(); ++i) {
    if (maps.cost.data()[i] < kUnverifiedCost && measured_depth.data()[i] > 0) continue;
    measured_depth.data()[i] = 0;
    measured_normal.data()[i] = {0, 0, 0};
  }
  const std::string& name = run.scene.images[index].name;
  const auto write = [&](const std::filesystem::path& path, const auto& writer, const auto& pixels) {
    MakeFolder(path.parent_path());
    writer(path, pixels);
  };
  const auto write_map = [](const auto& path, const auto& map) { WriteColmapMap(path, map); };
  write(WorkspaceOf(run) / "images" / name, WriteColorImage, run.frames.Get(index)->color);
  write(DepthFileOf(run, name), write_map, measured_depth);
  write(WorkspaceOf(run) / "stereo/normal_maps" / (name + ".geometric.bin"), write_map, measured_normal);
}

void WriteColmapWorkspace(const ReconstructRun& run, const std::set<int>& images,
                          const std::vector<PointCloud>& clouds) {
  // COLMAP's fusion has float32 coordinates, and so have most programs that read its models.
  const Eigen::Vector3d& origin = run.plan.origin;
  const RigidTransform world_from_model(Eigen::Translation3d{origin});
  std::vector<ColmapModelImage> model;
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> source_names;
  for (int index : images) {
    const SceneImage& image = run.scene.images[index];
    names.push_back(image.name);
    model.push_back({index + 1, image.name, CameraOf(run, index), WrittenPose(image).inverse() * world_from_model});
    std::vector<std::string>& sources = source_names.emplace_back();
    for (int source : run.plan.Find(index)->sources) {
      if (images.count(source) > 0) sources.push_back(run.scene.images[source].name);
    }
  }
  ColmapPoints points(ThinnedClouds(clouds, model));
  for (size_t i = 0; i < model.size(); ++i) {
    points.AddImage(i, {model[i].camera, model[i].cam_from_world}, ReadColmapMap(DepthFileOf(run, names[i])));
  }
  WriteColmapModel(WorkspaceOf(run), model, points.Take());
  WriteColmapLists(WorkspaceOf(run) / "stereo", names, source_names);
  if (origin.isZero(0)) return;
  const std::filesystem::path file = WorkspaceOf(run) / "origin.txt";
  WriteFileAtomically(file, StringPrintf("%.17g %.17g %.17g\n", origin.x(), origin.y(), origin.z()));
  run.progress.Warn(
      Concat("the scene is so far from its origin that COLMAP, whose coordinates are float32 here and there, "
             "would lose it: the model in ",
             WorkspaceOf(run).string(), " begins at the coordinates in ", file.filename().string()));
}

}  // namespace acmp
