#include "reconstruct_colmap.h"

#include <algorithm>
#include <map>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {
namespace {

constexpr Rgb kUnknownColor = {128, 128, 128};  // of a landmark: scenes do not have it
constexpr size_t kPointsPerCloud = 500;         // more do not change which images overlap

using Places = std::vector<std::vector<size_t>>;  ///< of each image: places in the list of images

/// The scene's landmarks with the images that observe them.
std::vector<ColmapModelPoint> LandmarksOf(const Scene& scene, const std::vector<int>& images) {
  std::map<int, ColmapModelPoint> points;
  for (size_t i = 0; i < images.size(); ++i) {
    for (int landmark : scene.images[images[i]].landmark_indices) {
      ColmapModelPoint& point = points[landmark];
      point.position_in_world = scene.landmarks_in_world[landmark];
      point.color = kUnknownColor;
      point.images.push_back(i);
    }
  }
  std::vector<ColmapModelPoint> list;
  list.reserve(points.size());
  for (auto& [landmark, point] : points) list.push_back(std::move(point));
  return list;
}

bool SomeAreShared(const std::vector<ColmapModelPoint>& points) {
  return std::any_of(points.begin(), points.end(), [](const auto& point) { return point.images.size() > 1; });
}

bool Sees(const ColmapModelImage& image, const Eigen::Vector3d& point_in_world) {
  const Eigen::Vector3d in_cam = image.cam_from_world * point_in_world;
  return in_cam.z() > 0 && image.camera.Contains(image.camera.Project(in_cam));
}

/// Stand-ins for landmarks: some fused points of each image, seen by it and by those of its source views that they lie
/// in. Hidden or not does not matter for the one use they have, to tell which images overlap.
std::vector<ColmapModelPoint> PointsOf(const std::vector<PointCloud>& clouds,
                                       const std::vector<ColmapModelImage>& images, const Places& sources) {
  std::vector<ColmapModelPoint> points;
  for (size_t i = 0; i < clouds.size(); ++i) {
    const size_t step = std::max<size_t>(1, clouds[i].size() / kPointsPerCloud);
    for (size_t k = 0; k < clouds[i].size(); k += step) {
      const auto& p = clouds[i][k].position;
      ColmapModelPoint point{{p.x, p.y, p.z}, clouds[i][k].color, {i}};
      for (size_t source : sources[i]) {
        if (Sees(images[source], point.position_in_world)) point.images.push_back(source);
      }
      points.push_back(std::move(point));
    }
  }
  return points;
}

}  // namespace

ColmapOutput::ColmapOutput(const ReconstructRun* run) : run_(*run), folder_(run->folder.path() / "colmap") {
  MakeFolder(folder_ / "sparse");
  for (const ImagePlan& image : run_.plan.images) {
    if (!image.no_map.empty()) continue;
    for (const auto& file : FilesOf(image.index)) MakeFolder(file.parent_path());
  }
}

void ColmapOutput::CheckNames(const Scene& scene, const std::vector<int>& indices) {
  for (int index : indices) CheckColmapName(scene.images[index].name);
}

std::filesystem::path ColmapOutput::MapFile(const char* kind, int index) const {
  return folder_ / "stereo" / kind / (run_.scene.images[index].name + ".geometric.bin");
}

std::vector<std::filesystem::path> ColmapOutput::FilesOf(int index) const {
  return {folder_ / "images" / run_.scene.images[index].name, MapFile("depth_maps", index),
          MapFile("normal_maps", index)};
}

void ColmapOutput::WriteMaps(int index, const StoredFinalMaps& maps) const {
  DepthMap measured_depth = Clone(maps.depth());
  NormalMap measured_normal = Clone(maps.normal());
  for (int row = 0; row < measured_depth.height(); ++row) {
    for (int col = 0; col < measured_depth.width(); ++col) {
      if (maps.cost()(col, row) < kUnverifiedCost && measured_depth(col, row) > 0) continue;
      measured_depth(col, row) = 0;
      measured_normal(col, row) = {0, 0, 0};
    }
  }
  WriteColorImage(folder_ / "images" / run_.scene.images[index].name, Clone(maps.color()));
  WriteColmapMap(MapFile("depth_maps", index), measured_depth);
  WriteColmapMap(MapFile("normal_maps", index), measured_normal);
}

Places ColmapOutput::SourcesWithin(const std::vector<int>& images) const {
  std::map<int, size_t> place;
  for (size_t i = 0; i < images.size(); ++i) place[images[i]] = i;
  Places sources(images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    const StoredFinalMaps maps = run_.store.Final(images[i]);
    for (int source : maps.sources()) {
      if (const auto found = place.find(source); found != place.end()) sources[i].push_back(found->second);
    }
  }
  return sources;
}

void ColmapOutput::WriteModel(const std::vector<int>& images, const std::vector<PointCloud>& clouds) const {
  std::vector<ColmapModelImage> model;
  std::vector<std::string> names;
  for (int index : images) {
    const SceneImage& image = run_.scene.images[index];
    names.push_back(image.name);
    model.push_back(
        {index + 1, image.name, CameraOf(run_.scene, index, run_.options.max_image_size), image.cam_from_world});
  }
  const Places sources = SourcesWithin(images);
  std::vector<ColmapModelPoint> points = LandmarksOf(run_.scene, images);
  // COLMAP fuses only images that share points.
  if (!SomeAreShared(points)) points = PointsOf(clouds, model, sources);
  WriteColmapModel(folder_ / "sparse", model, points);
  std::vector<std::vector<std::string>> source_names(images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    for (size_t source : sources[i]) source_names[i].push_back(names[source]);
  }
  WriteColmapLists(folder_ / "stereo", names, source_names);
}

}  // namespace acmp
