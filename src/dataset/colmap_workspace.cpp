#include "acmp_mapping/dataset/colmap_workspace.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <sstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

constexpr int kTextDigits = 15;           // of a double
constexpr double kColmapOffset_px = 0.5;  // COLMAP's pixel centres against ours
constexpr double kUnknownError_px = -1;   // a point's reprojection error

std::string MapHeader(int width, int height, int channels) { return Concat(width, "&", height, "&", channels, "&"); }

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
  std::ostringstream text = MakeTextFile(kTextDigits);
  text << "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: " << cameras.size() << '\n';
  for (size_t i = 0; i < cameras.size(); ++i) {
    const PinholeCamera& c = cameras[i].camera();
    const LensDistortion& distortion = cameras[i].distortion();
    const bool is_pinhole = distortion.model == LensDistortion::Model::kNone;
    if (!is_pinhole && distortion.model != LensDistortion::Model::kEquidistant) {
      throw InvalidInputError("a COLMAP model is written of pinhole and fisheye cameras only");
    }
    text << i + 1 << (is_pinhole ? " PINHOLE " : " OPENCV_FISHEYE ") << c.width << ' ' << c.height << ' ' << c.fx << ' '
         << c.fy << ' ' << c.cx + kColmapOffset_px << ' ' << c.cy + kColmapOffset_px;
    for (const double coefficient : distortion.coefficients) text << ' ' << coefficient;
    text << '\n';
  }
  WriteFileAtomically(path, text.str());
}

struct Feature {
  Eigen::Vector2d pixel;  ///< centres at integers
  size_t point_id = 0;
};

/// Writes the points, from id 1 on, and returns the features of each image.
std::vector<std::vector<Feature>> WritePoints(const std::filesystem::path& path,
                                              const std::vector<ColmapModelImage>& images,
                                              const std::vector<Lens>& cameras, const std::vector<size_t>& camera_of,
                                              const std::vector<ColmapModelPoint>& points) {
  std::vector<std::vector<Feature>> features(images.size());
  std::ostringstream lines = MakeTextFile(kTextDigits);
  size_t count = 0;
  for (const ColmapModelPoint& point : points) {
    std::ostringstream track = MakeTextFile(kTextDigits);
    for (size_t i : point.images) {
      const auto pixel = cameras[camera_of[i]].Project(images[i].cam_from_world * point.position_in_world);
      if (!pixel) continue;
      track << ' ' << images[i].id << ' ' << features[i].size();
      features[i].push_back({*pixel, count + 1});
    }
    if (track.str().empty()) continue;
    const Eigen::Vector3d& p = point.position_in_world;
    lines << ++count << ' ' << p.x() << ' ' << p.y() << ' ' << p.z() << ' ' << int{point.color.r} << ' '
          << int{point.color.g} << ' ' << int{point.color.b} << ' ' << kUnknownError_px << track.str() << '\n';
  }
  WriteFileAtomically(path, Concat("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
                                   "# Number of points: ",
                                   count, "\n", lines.str()));
  return features;
}

std::string FeatureLine(const std::vector<Feature>& features) {
  std::ostringstream line = MakeTextFile(kTextDigits);
  for (size_t i = 0; i < features.size(); ++i) {
    line << (i == 0 ? "" : " ") << features[i].pixel.x() + kColmapOffset_px << ' '
         << features[i].pixel.y() + kColmapOffset_px << ' ' << features[i].point_id;
  }
  return line.str();
}

void WriteImages(const std::filesystem::path& path, const std::vector<ColmapModelImage>& images,
                 const std::vector<size_t>& camera_of, const std::vector<std::vector<Feature>>& features) {
  std::ostringstream text = MakeTextFile(kTextDigits);
  text << "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n"
       << "# Number of images: " << images.size() << '\n';
  for (size_t i = 0; i < images.size(); ++i) {
    const Eigen::Quaterniond q(images[i].cam_from_world.linear());
    const Eigen::Vector3d t = images[i].cam_from_world.translation();
    text << images[i].id << ' ' << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' ' << t.x() << ' ' << t.y()
         << ' ' << t.z() << ' ' << camera_of[i] + 1 << ' ' << images[i].name << '\n'
         << FeatureLine(features[i]) << '\n';
  }
  WriteFileAtomically(path, text.str());
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

void CheckColmapName(const std::string& name) {
  const std::filesystem::path path(name);
  const bool forbidden = name.empty() || name[0] == '#' || name.find_first_of(" \t\r\n,") != std::string::npos;
  const bool leaves = path.is_absolute() || path.lexically_normal().string() != name || *path.begin() == "..";
  if (forbidden || leaves) {
    throw InvalidInputError(Concat("image name \"", name,
                                   "\": cannot be kept in a COLMAP workspace: must be relative, ",
                                   "without spaces, commas, a leading #, \".\" and \"..\""));
  }
}

void WriteColmapModel(const std::filesystem::path& folder, const std::vector<ColmapModelImage>& images,
                      const std::vector<ColmapModelPoint>& points) {
  std::vector<Lens> cameras;
  const std::vector<size_t> camera_of = FindCameras(images, &cameras);
  WriteCameras(folder / "cameras.txt", cameras);
  const auto features = WritePoints(folder / "points3D.txt", images, cameras, camera_of, points);
  WriteImages(folder / "images.txt", images, camera_of, features);
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

}  // namespace acmp
