#include <algorithm>

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
PointCloud ThinnedClouds(const std::vector<PointCloud>& clouds, const Eigen::Vector3d& origin,
                         const std::vector<ColmapModelImage>& images) {
  std::vector<double> depths;
  std::vector<PlacedCloud> placed;
  for (size_t i = 0; i < clouds.size(); ++i) {
    if (clouds[i].empty()) continue;
    std::vector<double> of_image(clouds[i].size());
    std::transform(clouds[i].begin(), clouds[i].end(), of_image.begin(), [&](const SurfacePoint& point) {
      return (images[i].cam_from_world * InWorld(origin, point.position)).z();
    });
    depths.push_back(Median(std::move(of_image)));
    placed.push_back({RigidTransform::Identity(), &clouds[i]});
  }
  return placed.empty() ? PointCloud() : MergeClouds(placed, static_cast<float>(kVoxelShare * Median(depths)));
}

}  // namespace

ColmapOutput::ColmapOutput(const ReconstructRun* run) : run_(*run), folder_(run->folder->path() / "colmap") {
  MakeFolder(folder_ / "stereo");
}

void ColmapOutput::CheckNames(const Scene& scene, const std::vector<int>& indices) {
  for (int index : indices) CheckColmapName(scene.images[index].name);
}

void ColmapOutput::WriteMaps(int index, const FinalMaps& maps) const {
  DepthMap measured_depth = maps.depth.Clone();
  NormalMap measured_normal = maps.normal.Clone();
  for (size_t i = 0; i < measured_depth.size(); ++i) {
    if (maps.cost.data()[i] < kUnverifiedCost && measured_depth.data()[i] > 0) continue;
    measured_depth.data()[i] = 0;
    measured_normal.data()[i] = {0, 0, 0};
  }
  const std::string& name = run_.scene.images[index].name;
  const auto write = [&](const std::filesystem::path& path, const auto& writer, const auto& pixels) {
    MakeFolder(path.parent_path());
    writer(path, pixels);
    StartWriteback(path);
  };
  const auto write_map = [](const auto& path, const auto& map) { WriteColmapMap(path, map); };
  write(folder_ / "images" / name, WriteColorImage, run_.store.FrameOf(index)->color);
  write(DepthFile(name), write_map, measured_depth);
  write(folder_ / "stereo/normal_maps" / (name + ".geometric.bin"), write_map, measured_normal);
}

std::filesystem::path ColmapOutput::DepthFile(const std::string& name) const {
  return folder_ / "stereo/depth_maps" / (name + ".geometric.bin");
}

void ColmapOutput::WriteModel(const std::set<int>& images, const std::vector<PointCloud>& clouds) const {
  std::vector<ColmapModelImage> model;
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> source_names;
  for (int index : images) {
    const SceneImage& image = run_.scene.images[index];
    names.push_back(image.name);
    model.push_back({index + 1, image.name, CameraOf(run_, index), WrittenPose(image).inverse()});
    std::vector<std::string>& sources = source_names.emplace_back();
    for (int source : run_.plan.Find(index)->sources) {
      if (images.count(source) > 0) sources.push_back(run_.scene.images[source].name);
    }
  }
  ColmapPoints points(ThinnedClouds(clouds, run_.plan.origin, model), run_.plan.origin);
  for (size_t i = 0; i < model.size(); ++i) {
    points.AddImage(i, {model[i].camera, model[i].cam_from_world}, ReadColmapMap(DepthFile(names[i])));
  }
  WriteColmapModel(folder_, model, points.Take());
  WriteColmapLists(folder_ / "stereo", names, source_names);
}

}  // namespace acmp
