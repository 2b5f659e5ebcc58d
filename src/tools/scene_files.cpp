#include "scene_files.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iomanip>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/source_view_selector.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

constexpr int kDigits = 12;               // of a double in text files
constexpr double kColmapOffset_px = 0.5;  // COLMAP's pixel centres against ours

std::string Numbered(const char* format, size_t index) {
  char text[32];
  std::snprintf(text, sizeof(text), format, index);
  return text;
}

std::string ImageName(size_t index) { return Numbered("%06zu.png", index); }

std::ostringstream TextFile() {
  std::ostringstream text;
  text << std::setprecision(kDigits);
  return text;
}

std::string QuaternionAndTranslation(const RigidTransform& transform) {
  const Eigen::Quaterniond q(transform.linear());
  std::ostringstream text = TextFile();
  text << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z();
  for (int i = 0; i < 3; ++i) text << ' ' << transform.translation()[i];
  return text.str();
}

// One landmark and where it is seen.
struct Track {
  Eigen::Vector3d point_in_world;
  Rgb color;
  std::vector<std::pair<size_t, size_t>> observations;  ///< view, number within the view
};

// A landmark has the same coordinates in every view that observes it.
std::vector<Track> FindTracks(const std::vector<SyntheticView>& views) {
  std::map<std::tuple<double, double, double>, size_t> index;
  std::vector<Track> tracks;
  for (size_t view = 0; view < views.size(); ++view) {
    const Frame& frame = views[view].frame;
    for (size_t i = 0; i < frame.landmarks_in_world.size(); ++i) {
      const Eigen::Vector3d& point = frame.landmarks_in_world[i];
      const auto [at, is_new] = index.emplace(std::make_tuple(point.x(), point.y(), point.z()), tracks.size());
      if (is_new) {
        const Eigen::Vector2d pixel = frame.camera.Project(frame.cam_from_world * point);
        const int col = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, frame.camera.width - 1);
        const int row = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, frame.camera.height - 1);
        tracks.push_back({point, frame.color(col, row), {}});
      }
      tracks[at->second].observations.emplace_back(view, i);
    }
  }
  return tracks;
}

void WriteMaps(const fs::path& folder, const std::vector<SyntheticView>& views) {
  for (const char* name : {"images", "depth", "low_texture"}) MakeFolder(folder / name);
  for (size_t i = 0; i < views.size(); ++i) {
    const SyntheticView& view = views[i];
    WritePng(folder / "images" / ImageName(i), view.frame.color);
    WriteDepthPng(folder / "depth" / ImageName(i), view.true_depth);  // the room ends at 7 m: all can be stored
    ColorImage mask(view.low_texture.width(), view.low_texture.height());
    std::transform(view.low_texture.begin(), view.low_texture.end(), mask.begin(), [](unsigned char blank) {
      const unsigned char value = blank ? 255 : 0;
      return Rgb{value, value, value};
    });
    WritePng(folder / "low_texture" / ImageName(i), mask);
  }
}

void WriteCameraList(const fs::path& folder, const std::vector<SyntheticView>& views) {
  std::ostringstream text = TextFile();
  text << "# one line per image: index filename fx fy cx cy width height qw qx qy qz tx ty tz\n"
          "# pinhole without distortion, pixel centres at integers; qw..tz: T_world_cam (camera to world), metres\n";
  for (size_t i = 0; i < views.size(); ++i) {
    const PinholeCamera& c = views[i].frame.camera;
    text << i << ' ' << ImageName(i) << ' ' << c.fx << ' ' << c.fy << ' ' << c.cx << ' ' << c.cy << ' ' << c.width
         << ' ' << c.height << ' ' << QuaternionAndTranslation(views[i].frame.cam_from_world.inverse()) << '\n';
  }
  WriteFileAtomically(folder / "cameras.txt", text.str());
}

DepthRange RangeOf(const SyntheticView& view) {
  const Frame& frame = view.frame;
  const auto range = DepthRangeFromLandmarks(frame.landmarks_in_world, frame.camera, frame.cam_from_world, {});
  if (range) return *range;
  const auto [nearest, farthest] = std::minmax_element(view.true_depth.begin(), view.true_depth.end());
  return {*nearest, *farthest};  // a tiny picture with hardly a landmark
}

void WriteMvsnetCameras(const fs::path& folder, const std::vector<SyntheticView>& views) {
  constexpr int kPlanes = 192;  // what MVSNet's files name; the interval follows
  MakeFolder(folder / "cams");
  for (size_t i = 0; i < views.size(); ++i) {
    const DepthRange range = RangeOf(views[i]);
    std::ostringstream text = TextFile();
    const Eigen::IOFormat rows(kDigits, Eigen::DontAlignCols, " ", "\n");
    text << "extrinsic\n"
         << views[i].frame.cam_from_world.matrix().format(rows) << "\n\nintrinsic\n"
         << views[i].frame.camera.K().format(rows) << "\n\n"
         << range.min << ' ' << (range.max - range.min) / (kPlanes - 1) << ' ' << kPlanes << ' ' << range.max << '\n';
    WriteFileAtomically(folder / "cams" / Numbered("%08zu_cam.txt", i), text.str());
  }
}

// The line of the image itself is left out of its candidates, so positions behind it are one less than indices.
void WritePairs(const fs::path& folder, const std::vector<SyntheticView>& views) {
  SourceViewOptions options;
  options.max_source_views = 10;
  const double table_distance_m = 2.5;
  std::ostringstream text = TextFile();
  text << views.size() << '\n';
  for (size_t i = 0; i < views.size(); ++i) {
    std::vector<FramePtr> candidates;
    for (size_t j = 0; j < views.size(); ++j) {
      // The views outlive the call: pointers that do not own.
      if (j != i) candidates.emplace_back(FramePtr(), &views[j].frame);
    }
    const auto sources = SelectSourceViews(views[i].frame, candidates, table_distance_m, options);
    text << i << '\n' << sources.size();
    for (const RankedSourceView& source : sources) {
      text << ' ' << (source.index < i ? source.index : source.index + 1) << ' ' << source.score;
    }
    text << '\n';
  }
  WriteFileAtomically(folder / "pair.txt", text.str());
}

void WriteColmapModel(const fs::path& folder, const std::vector<SyntheticView>& views,
                      const std::vector<Track>& tracks) {
  MakeFolder(folder);
  const PinholeCamera& camera = views.front().frame.camera;
  std::ostringstream cameras = TextFile();
  cameras << "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE " << camera.width << ' ' << camera.height << ' '
          << camera.fx << ' ' << camera.fy << ' ' << camera.cx + kColmapOffset_px << ' ' << camera.cy + kColmapOffset_px
          << '\n';
  WriteFileAtomically(folder / "cameras.txt", cameras.str());

  std::vector<std::vector<size_t>> track_of(views.size());  // by view and number within the view
  std::ostringstream points = TextFile();
  points << "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";
  for (size_t t = 0; t < tracks.size(); ++t) {
    const Track& track = tracks[t];
    const Eigen::Vector3d& p = track.point_in_world;
    points << t + 1 << ' ' << p.x() << ' ' << p.y() << ' ' << p.z() << ' ' << int{track.color.r} << ' '
           << int{track.color.g} << ' ' << int{track.color.b} << " 0";
    for (const auto& [view, number] : track.observations) {
      points << ' ' << view + 1 << ' ' << number;
      track_of[view].push_back(t);  // a view meets its landmarks in the order of their numbers
    }
    points << '\n';
  }
  WriteFileAtomically(folder / "points3D.txt", points.str());

  std::ostringstream images = TextFile();
  images << "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n";
  for (size_t i = 0; i < views.size(); ++i) {
    const Frame& frame = views[i].frame;
    images << i + 1 << ' ' << QuaternionAndTranslation(frame.cam_from_world) << " 1 " << ImageName(i) << '\n';
    for (size_t k = 0; k < frame.landmarks_in_world.size(); ++k) {
      const Eigen::Vector2d pixel = camera.Project(frame.cam_from_world * frame.landmarks_in_world[k]);
      images << (k == 0 ? "" : " ") << pixel.x() + kColmapOffset_px << ' ' << pixel.y() + kColmapOffset_px << ' '
             << track_of[i][k] + 1;
    }
    images << '\n';
  }
  WriteFileAtomically(folder / "images.txt", images.str());
}

PointCloud CloudOf(const std::vector<Track>& tracks) {
  PointCloud cloud;
  for (const Track& track : tracks) {
    const Eigen::Vector3f p = track.point_in_world.cast<float>();
    cloud.push_back({{p.x(), p.y(), p.z()}, {0, 0, 0}, track.color, 1.0f});
  }
  return cloud;
}

}  // namespace

void WriteSceneFiles(const fs::path& folder, const std::vector<SyntheticView>& views, float surface_spacing_m) {
  MakeFolder(folder);
  const std::vector<Track> tracks = FindTracks(views);
  WriteMaps(folder, views);
  WriteMvsnetCameras(folder, views);
  WritePairs(folder, views);
  WriteColmapModel(folder / "sparse", views, tracks);
  WritePly(folder / "sparse.ply", CloudOf(tracks));
  WritePly(folder / "surface.ply", SampleSyntheticSurface(views, surface_spacing_m));
  WriteCameraList(folder, views);  // last: a folder with this file is whole
}

}  // namespace acmp
