#include "acmp_mapping/dataset/colmap_workspace.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <locale>
#include <sstream>
#include <system_error>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/output_file.h"
#include "image_codec_private.h"
#include "input_file.h"

namespace acmp {
namespace {

constexpr std::array<const char*, 3> kModelFiles = {"cameras.bin", "points3D.bin", "images.bin"};

constexpr int32_t kPinholeModel = 1;      // COLMAP's CAMERA_MODEL_ID of PINHOLE
constexpr int32_t kFisheyeModel = 5;      // and of OPENCV_FISHEYE
constexpr size_t kMaxMapHeader = 64;      // three numbers
constexpr double kColmapOffset_px = 0.5;  // COLMAP's pixel centres against ours
constexpr double kUnknownError_px = -1;   // a point's reprojection error

std::string MapHeader(int64_t width, int64_t height, int channels) {
  return Concat(width, "&", height, "&", channels, "&");
}

/// Number of each image's camera among those that differ.
std::vector<size_t> FindCameras(const std::vector<ColmapModelImage>& images, std::vector<Lens>* cameras) {
  std::vector<size_t> camera_of;
  for (const ColmapModelImage& image : images) {
    // Neighbours mostly share one: from the back.
    const auto found = std::find_if(cameras->rbegin(), cameras->rend(), [&](const Lens& lens) {
      return lens.camera() == image.camera && lens.distortion() == image.distortion;
    });
    camera_of.push_back(found == cameras->rend() ? cameras->size() : static_cast<size_t>(cameras->rend() - found) - 1);
    if (found == cameras->rend()) cameras->push_back({image.camera, image.distortion});
  }
  return camera_of;
}

void WriteCameras(const std::filesystem::path& path, const std::vector<Lens>& cameras) {
  AtomicFile file(path);
  file.Put(uint64_t{cameras.size()});
  for (size_t i = 0; i < cameras.size(); ++i) {
    const PinholeCamera& c = cameras[i].camera();
    const LensDistortion& distortion = cameras[i].distortion();
    const bool is_pinhole = distortion.model == LensDistortion::Model::kNone;
    if (!is_pinhole && distortion.model != LensDistortion::Model::kEquidistant) {
      throw InvalidInputError("a COLMAP model is written of pinhole and fisheye cameras only");
    }
    file.Put(static_cast<uint32_t>(i + 1), is_pinhole ? kPinholeModel : kFisheyeModel, static_cast<uint64_t>(c.width),
             static_cast<uint64_t>(c.height), c.fx, c.fy, c.cx + kColmapOffset_px, c.cy + kColmapOffset_px);
    for (const double coefficient : distortion.coefficients) file.Put(coefficient);
  }
  file.Commit();
}

struct Feature {
  Eigen::Vector2d pixel;  ///< centres at integers
  uint64_t point_id = 0;
};

/// Writes the points, from id 1 on, and returns the features of each image.
std::vector<std::vector<Feature>> WritePoints(const std::filesystem::path& path,
                                              const std::vector<ColmapModelImage>& images,
                                              const std::vector<Lens>& cameras, const std::vector<size_t>& camera_of,
                                              const std::vector<ColmapModelPoint>& points) {
  std::vector<std::vector<Feature>> features(images.size());
  const auto pixel_in = [&](const ColmapModelPoint& point, size_t i) {
    return cameras[camera_of[i]].Project(images[i].cam_from_world * point.position_in_world);
  };
  const auto views = [&](const ColmapModelPoint& point) {
    return static_cast<uint64_t>(std::count_if(point.images.begin(), point.images.end(),
                                               [&](size_t image) { return pixel_in(point, image).has_value(); }));
  };
  AtomicFile file(path);
  file.Put(static_cast<uint64_t>(
      std::count_if(points.begin(), points.end(), [&](const ColmapModelPoint& point) { return views(point) > 0; })));
  uint64_t id = 0;
  for (const ColmapModelPoint& point : points) {
    const uint64_t length = views(point);
    if (length == 0) continue;
    const Eigen::Vector3d& p = point.position_in_world;
    file.Put(++id, p.x(), p.y(), p.z(), point.color.r, point.color.g, point.color.b, kUnknownError_px, length);
    for (size_t i : point.images) {
      const auto pixel = pixel_in(point, i);
      if (!pixel) continue;
      file.Put(static_cast<uint32_t>(images[i].id), static_cast<uint32_t>(features[i].size()));
      features[i].push_back({*pixel, id});
    }
  }
  file.Commit();
  return features;
}

void WriteImages(const std::filesystem::path& path, const std::vector<ColmapModelImage>& images,
                 const std::vector<size_t>& camera_of, const std::vector<std::vector<Feature>>& features) {
  AtomicFile file(path);
  file.Put(uint64_t{images.size()});
  for (size_t i = 0; i < images.size(); ++i) {
    const Eigen::Quaterniond q(images[i].cam_from_world.linear());
    const Eigen::Vector3d t = images[i].cam_from_world.translation();
    file.Put(static_cast<uint32_t>(images[i].id), q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z(),
             static_cast<uint32_t>(camera_of[i] + 1));
    file.Write(images[i].name.c_str(), images[i].name.size() + 1);
    file.Put(uint64_t{features[i].size()});
    for (const Feature& feature : features[i]) {
      file.Put(feature.pixel.x() + kColmapOffset_px, feature.pixel.y() + kColmapOffset_px, feature.point_id);
    }
  }
  file.Commit();
}

/// The model's file also where programs look that know workspaces with one model only. A copy where there are no links.
void LinkFromAbove(const std::filesystem::path& file) {
  const std::filesystem::path link = file.parent_path().parent_path() / file.filename();
  std::error_code error;
  std::filesystem::remove(link, error);
  std::filesystem::create_symlink(file.parent_path().filename() / file.filename(), link, error);
  if (error) std::filesystem::copy_file(file, link, error);
  if (error) throw ProcessingError(Concat("cannot write ", link.string(), ": ", error.message()));
}

}  // namespace

void WriteColmapMap(const std::filesystem::path& path, const Image<float>& map) {
  AtomicFile file(path);
  file.Write(MapHeader(map.width(), map.height(), 1));
  file.Write(map.data(), map.size() * sizeof(float));
  file.Commit();
}

void WriteColmapMap(const std::filesystem::path& path, const NormalMap& map) {
  AtomicFile file(path);
  file.Write(MapHeader(map.width(), map.height(), 3));
  std::vector<float> plane(map.size());
  for (float Vec3f::*channel : {&Vec3f::x, &Vec3f::y, &Vec3f::z}) {
    std::transform(map.begin(), map.end(), plane.begin(), [channel](const Vec3f& normal) { return normal.*channel; });
    file.Write(plane.data(), plane.size() * sizeof(float));
  }
  file.Commit();
}

Image<float> ReadColmapMap(const std::filesystem::path& path) {
  BinaryReader file(path);
  std::string header;
  for (int separators = 0; separators < 3 && header.size() < kMaxMapHeader;) {
    header += file.Read<char>("header");
    separators += header.back() == '&' ? 1 : 0;
  }
  std::istringstream numbers(header);
  numbers.imbue(std::locale::classic());
  int64_t width = 0, height = 0;
  char separator = 0;
  numbers >> width >> separator >> height;
  if (width <= 0 || height <= 0 || header != MapHeader(width, height, 1)) {
    file.Fail(Concat("header \"", header, "\": must be WIDTH&HEIGHT&1&"));
  }
  CheckImageSize(path, static_cast<uint64_t>(width), static_cast<uint64_t>(height));
  Image<float> map(static_cast<int>(width), static_cast<int>(height));
  file.ReadBytes(map.data(), map.size() * sizeof(float), "depths");
  file.ExpectEnd();
  return map;
}

void CheckColmapName(const std::string& name) {
  const std::filesystem::path path(name);
  const bool forbidden = name.empty() || name[0] == '#' || name.find_first_of(" \t\r\n,") != std::string::npos;
  const bool leaves = path.is_absolute() || path.lexically_normal().string() != name || *path.begin() == "..";
  // What files of it are named after it besides must fit into the 255 bytes that file systems give a name.
  constexpr size_t kMaxBytes = 220;
  const bool is_long =
      std::any_of(path.begin(), path.end(), [](const auto& part) { return part.native().size() > kMaxBytes; });
  if (forbidden || leaves || is_long) {
    throw InvalidInputError(Concat("image name \"", name,
                                   "\": cannot be kept in a COLMAP workspace: must be relative, ",
                                   "without spaces, commas, a leading #, \".\" and \"..\", and with at most ",
                                   kMaxBytes, " bytes between slashes"));
  }
}

std::set<std::string> ColmapModelFiles() {
  std::set<std::string> names;
  for (const char* name : kModelFiles) names.insert({Concat("sparse/0/", name), Concat("sparse/", name)});
  return names;
}

void WriteColmapModel(const std::filesystem::path& workspace, const std::vector<ColmapModelImage>& images,
                      const std::vector<ColmapModelPoint>& points) {
  const std::filesystem::path folder = workspace / "sparse/0";
  MakeFolder(folder);
  std::vector<Lens> cameras;
  const std::vector<size_t> camera_of = FindCameras(images, &cameras);
  WriteCameras(folder / "cameras.bin", cameras);
  const auto features = WritePoints(folder / "points3D.bin", images, cameras, camera_of, points);
  WriteImages(folder / "images.bin", images, camera_of, features);
  for (const char* name : kModelFiles) LinkFromAbove(folder / name);
}

void WriteColmapLists(const std::filesystem::path& stereo_folder, const std::vector<std::string>& names,
                      const std::vector<std::vector<std::string>>& sources) {
  std::string fusion;
  std::string patch_match;
  for (size_t i = 0; i < names.size(); ++i) {
    fusion += names[i] + "\n";
    std::string list;
    for (const std::string& source : sources[i]) list += (list.empty() ? "" : ", ") + source;
    // An empty line would be skipped and the next image taken for this one's source; the number is COLMAP's default.
    patch_match += names[i] + "\n" + (list.empty() ? "__auto__, 20" : list) + "\n";
  }
  WriteFileAtomically(stereo_folder / "fusion.cfg", fusion);
  WriteFileAtomically(stereo_folder / "patch-match.cfg", patch_match);
}

ColmapPoints::ColmapPoints(const PointCloud& cloud, const Eigen::Vector3d& origin) {
  const size_t count = std::min(cloud.size(), kMaxPoints);
  points_.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    const SurfacePoint& point = cloud[i * cloud.size() / count];
    const Vec3f& p = point.position;
    points_.push_back({origin + Eigen::Vector3d(p.x, p.y, p.z), point.color, {}});
  }
  views_.resize(count);
  unconfirmed_.assign(count, kNone);
}

void ColmapPoints::AddImage(size_t image, const PosedCamera& camera, const DepthMap& depth) {
  CheckSize("depth map", depth.width(), depth.height(), camera.camera);
  for (size_t i = 0; i < points_.size(); ++i) {
    const Eigen::Vector3d in_cam = camera.cam_from_world * points_[i].position_in_world;
    const auto pixel = camera.camera.PixelOf(in_cam);
    if (!pixel) continue;
    const double seen = depth(pixel->x(), pixel->y());
    if (!(seen > 0)) unconfirmed_[i] = std::min(unconfirmed_[i], static_cast<uint32_t>(image));
    if (!(std::abs(seen - in_cam.z()) <= kMaxRelativeDepth * in_cam.z())) continue;
    // Reservoir sampling (Vitter, 1985), with numbers that depend on the point and the view alone.
    std::vector<size_t>& images = points_[i].images;
    const uint32_t view = views_[i]++;
    if (images.size() < kMaxTrack) {
      images.push_back(image);
    } else if (const uint32_t place = HashWord(HashWord(static_cast<uint32_t>(i)) + view) % (view + 1);
               place < kMaxTrack) {
      images[place] = image;
    }
  }
}

std::vector<ColmapModelPoint> ColmapPoints::Take() {
  for (size_t i = 0; i < points_.size(); ++i) {
    if (points_[i].images.empty() && unconfirmed_[i] != kNone) points_[i].images = {unconfirmed_[i]};
  }
  return std::move(points_);
}

}  // namespace acmp
