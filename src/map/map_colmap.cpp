// A map as a COLMAP model.

#include <algorithm>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/folder_record.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/voxel_map.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

/// By time, then by mapper; what has the same, as faces of a wide camera or two runs of a mapper, is numbered.
/// Without dots, at which some trainers cut names off, and no longer than a file's name may be.
std::string ImageNameOf(const PlacedKeyframe& keyframe, std::set<std::string>* names) {
  constexpr int64_t kSecond_ns = 1000000000;
  const std::string stamp = StringPrintf("%010lld_%09lld", static_cast<long long>(keyframe.stamp_ns / kSecond_ns),
                                         static_cast<long long>(keyframe.stamp_ns % kSecond_ns));
  std::string mapper = keyframe.key.mapper;
  mapper.erase(0, mapper.find_first_not_of('/'));
  std::replace(mapper.begin(), mapper.end(), '/', '_');
  constexpr size_t kMaxMapper = 100;  // characters
  const std::string name = Concat(stamp, "_", mapper.substr(0, kMaxMapper));
  std::string unique = name;
  for (size_t number = 2; !names->insert(unique).second; ++number) unique = Concat(name, "_", number);
  return unique + ".jpg";
}

/// What the keyframe's camera sees of its points.
SurfaceMaps SeenBy(const PlacedKeyframe& keyframe, const PosedCamera& camera, double voxel_size) {
  const PointCloud points = keyframe.points_in_camera->Unpack();
  const double spacing = keyframe.scale * PointSpacing(points, voxel_size);
  return SplatPoints(Scaled(points, keyframe.scale), camera, spacing);
}

}  // namespace

ColmapFolder WriteColmapFolder(const fs::path& path, const PlacedKeyframes& map, const std::function<void()>& check) {
  if (map.keyframes.empty()) throw InvalidInputError("the map is empty: nothing was written");
  ColmapFolder written;
  std::vector<const PlacedKeyframe*> keyframes;
  for (const PlacedKeyframe& keyframe : map.keyframes) {
    if (keyframe.points_in_camera->empty()) {
      ++written.without_points;
    } else if (!keyframe.image) {
      ++written.without_image;
    } else {
      keyframes.push_back(&keyframe);
    }
  }
  if (keyframes.empty()) {
    throw InvalidInputError(Concat("the map has ", map.keyframes.size(),
                                   " keyframes and no image of them: nothing was ",
                                   "written; start the mappers with ~keep_images, such as 1600 px"));
  }
  std::stable_sort(keyframes.begin(), keyframes.end(),
                   [](const PlacedKeyframe* a, const PlacedKeyframe* b) { return a->stamp_ns < b->stamp_ns; });
  std::set<std::string> names, files = ColmapModelFiles();
  std::vector<std::string> image_names;
  for (const PlacedKeyframe* keyframe : keyframes) {
    image_names.push_back(ImageNameOf(*keyframe, &names));
    files.insert("images/" + image_names.back());
  }
  AtomicFolder folder(path, files);
  MakeFolder(folder.temporary_path() / "images");
  ColmapPoints points(CloudOf(map).points);
  std::vector<ColmapModelImage> images;
  for (const PlacedKeyframe* keyframe : keyframes) {
    check();
    const RigidTransform cam_from_world = keyframe->world_from_cam.inverse();
    const PosedCamera camera = {keyframe->camera, cam_from_world};
    const SurfaceMaps seen = SeenBy(*keyframe, camera, map.voxel_size);
    points.AddImage(images.size(), seen.camera, seen.depth);
    images.push_back(
        {static_cast<int>(images.size() + 1), image_names[images.size()], keyframe->image->camera(), cam_from_world});
    WriteFileAtomically(folder.temporary_path() / "images" / images.back().name, keyframe->image->Read());
  }
  const std::vector<ColmapModelPoint> seen = points.Take();
  WriteColmapModel(folder.temporary_path(), images, seen);
  check();
  folder.Commit();
  written.images = images.size();
  written.points = static_cast<size_t>(
      std::count_if(seen.begin(), seen.end(), [](const ColmapModelPoint& point) { return !point.images.empty(); }));
  return written;
}

}  // namespace acmp
