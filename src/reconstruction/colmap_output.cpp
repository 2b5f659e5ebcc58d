#include <algorithm>
#include <map>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "image_files.h"

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

/// Stand-ins for landmarks: some fused points of each image, seen by it and by those of its source views that they lie
/// in. Hidden or not does not matter for the one use they have, to tell which images overlap.
std::vector<ColmapModelPoint> PointsOf(const std::vector<PointCloud>& clouds, const Eigen::Vector3d& origin,
                                       const std::vector<ColmapModelImage>& images, const Places& sources) {
  std::vector<ColmapModelPoint> points;
  for (size_t i = 0; i < clouds.size(); ++i) {
    const size_t step = std::max<size_t>(1, clouds[i].size() / kPointsPerCloud);
    for (size_t k = 0; k < clouds[i].size(); k += step) {
      ColmapModelPoint point{InWorld(origin, clouds[i][k].position), clouds[i][k].color, {i}};
      for (size_t source : sources[i]) {
        if (DepthInView(point.position_in_world, images[source].camera, images[source].cam_from_world) > 0) {
          point.images.push_back(source);
        }
      }
      points.push_back(std::move(point));
    }
  }
  return points;
}

}  // namespace

ColmapOutput::ColmapOutput(const ReconstructRun* run) : run_(*run), folder_(run->folder->path() / "colmap") {
  for (const char* name : {"sparse", "stereo"}) MakeFolder(folder_ / name);
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
  write(folder_ / "images" / name, WriteColorImage, maps.color);
  write(folder_ / "stereo/depth_maps" / (name + ".geometric.bin"), write_map, measured_depth);
  write(folder_ / "stereo/normal_maps" / (name + ".geometric.bin"), write_map, measured_normal);
}

Places ColmapOutput::SourcesWithin(const std::vector<int>& images) const {
  std::map<int, size_t> place;
  for (size_t i = 0; i < images.size(); ++i) place[images[i]] = i;
  Places sources(images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    for (int source : run_.plan.Find(images[i])->sources) {
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
    model.push_back({index + 1, image.name, CameraOf(run_, index), image.cam_from_world});
  }
  const Places sources = SourcesWithin(images);
  std::vector<ColmapModelPoint> points = LandmarksOf(run_.scene, images);
  // COLMAP fuses only images that share points.
  if (!SomeAreShared(points)) points = PointsOf(clouds, run_.plan.origin, model, sources);
  WriteColmapModel(folder_ / "sparse", model, points);
  std::vector<std::vector<std::string>> source_names(images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    for (size_t source : sources[i]) source_names[i].push_back(names[source]);
  }
  WriteColmapLists(folder_ / "stereo", names, source_names);
}

}  // namespace acmp
