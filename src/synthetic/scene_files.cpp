#include "acmp_mapping/synthetic/synthetic_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <sstream>
#include <string>
#include <tuple>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/source_view_selection.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

constexpr int kDigits = 12;  // of a double in text files

std::string ImageName(size_t index) { return StringPrintf("%06zu.png", index); }

// One landmark and where it is seen.
struct Track {
  Eigen::Vector3d point_in_world;
  Rgb color;
  std::vector<size_t> views;
};

// A landmark has the same coordinates in every view that observes it.
std::vector<Track> FindTracks(const std::vector<SyntheticView>& views) {
  std::map<std::tuple<double, double, double>, size_t> index;
  std::vector<Track> tracks;
  for (size_t view = 0; view < views.size(); ++view) {
    const Frame& frame = views[view].frame;
    const auto& wide = views[view].wide;
    for (const Eigen::Vector3d& point : wide ? wide->landmarks_in_world : frame.landmarks_in_world) {
      const auto [at, is_new] = index.emplace(std::make_tuple(point.x(), point.y(), point.z()), tracks.size());
      if (is_new) {
        const Eigen::Vector3d in_cam = frame.cam_from_world * point;
        const Eigen::Vector2d pixel =
            wide ? wide->lens.Project(in_cam).value_or(Eigen::Vector2d::Zero()) : frame.camera.Project(in_cam);
        const ColorImage& image = wide ? wide->color : frame.color;
        const int col = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, image.width() - 1);
        const int row = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, image.height() - 1);
        tracks.push_back({point, image(col, row), {}});
      }
      tracks[at->second].views.push_back(view);
    }
  }
  return tracks;
}

ColorImage Picture(const Image<unsigned char>& gray) {
  ColorImage picture(gray.width(), gray.height());
  std::transform(gray.begin(), gray.end(), picture.begin(), [](unsigned char value) {
    const unsigned char level = value != 0 ? 255 : 0;
    return Rgb{level, level, level};
  });
  return picture;
}

void WriteMaps(const fs::path& folder, const std::vector<SyntheticView>& views) {
  for (const char* name : {"images", "depth", "low_texture"}) MakeFolder(folder / name);
  for (size_t i = 0; i < views.size(); ++i) {
    const SyntheticView& view = views[i];
    WritePng(folder / "images" / ImageName(i), view.frame.color);
    WriteDepthPng(folder / "depth" / ImageName(i), view.true_depth);  // the room ends at 7 m: all can be stored
    WritePng(folder / "low_texture" / ImageName(i), Picture(view.low_texture));
    if (view.frame.mask.empty()) continue;
    MakeFolder(folder / "masks");
    WritePng(folder / "masks" / (ImageName(i) + ".png"), Picture(view.frame.mask));
  }
}

std::vector<ListedCamera> CamerasOf(const std::vector<SyntheticView>& views) {
  std::vector<ListedCamera> cameras;
  for (size_t i = 0; i < views.size(); ++i) {
    const Frame& frame = views[i].frame;
    cameras.push_back({{static_cast<int>(i), ImageName(i)}, frame.camera, frame.cam_from_world.inverse()});
  }
  return cameras;
}

DepthRange RangeOf(const SyntheticView& view) {
  const Frame& frame = view.frame;
  const auto range = DepthRangeFromLandmarks(frame.landmarks_in_world, frame.camera, frame.cam_from_world);
  if (range) return *range;
  // A tiny picture with hardly a landmark.
  DepthRange known = {std::numeric_limits<float>::max(), 0};
  for (const float depth : view.true_depth) {
    if (depth > 0) known = {std::min(known.min, depth), std::max(known.max, depth)};
  }
  return known;
}

void WriteMvsnetCameras(const fs::path& folder, const std::vector<SyntheticView>& views) {
  constexpr int kPlanes = 192;  // what MVSNet's files name; the interval follows
  MakeFolder(folder / "cams");
  for (size_t i = 0; i < views.size(); ++i) {
    const DepthRange range = RangeOf(views[i]);
    std::ostringstream text = MakeTextFile(kDigits);
    const Eigen::IOFormat rows(kDigits, Eigen::DontAlignCols, " ", "\n");
    text << "extrinsic\n"
         << views[i].frame.cam_from_world.matrix().format(rows) << "\n\nintrinsic\n"
         << views[i].frame.camera.K().format(rows) << "\n\n"
         << range.min << ' ' << (range.max - range.min) / (kPlanes - 1) << ' ' << kPlanes << ' ' << range.max << '\n';
    WriteFileAtomically(folder / "cams" / StringPrintf("%08zu_cam.txt", i), text.str());
  }
}

void WritePairs(const fs::path& folder, const std::vector<SyntheticView>& views) {
  constexpr int kSources = 10;
  std::ostringstream text = MakeTextFile(kDigits);
  text << views.size() << '\n';
  std::vector<SourceViewCandidate> all;
  all.reserve(views.size());
  for (const SyntheticView& view : views) all.push_back({{view.frame.camera, view.frame.cam_from_world}});
  for (size_t i = 0; i < views.size(); ++i) {
    const auto sources = SelectSourceViews(all[i].view, RangeOf(views[i]), all, kSources).views;
    text << i << '\n' << sources.size();
    for (const SelectedSourceView& source : sources) text << ' ' << source.index << ' ' << source.gain;
    text << '\n';
  }
  WriteFileAtomically(folder / "pair.txt", text.str());
}

void WriteSparseModel(const fs::path& folder, const std::vector<SyntheticView>& views,
                      const std::vector<Track>& tracks) {
  std::vector<ColmapModelImage> images;
  for (size_t i = 0; i < views.size(); ++i) {
    const Frame& frame = views[i].frame;
    const auto& wide = views[i].wide;
    images.push_back({static_cast<int>(i) + 1, ImageName(i), wide ? wide->lens.camera() : frame.camera,
                      frame.cam_from_world, wide ? wide->lens.distortion() : LensDistortion()});
  }
  std::vector<ColmapModelPoint> points;
  points.reserve(tracks.size());
  for (const Track& track : tracks) points.push_back({track.point_in_world, track.color, track.views});
  WriteColmapModel(folder, images, points);
}

PointCloud CloudOf(const std::vector<Track>& tracks) {
  PointCloud cloud;
  for (const Track& track : tracks) {
    const Eigen::Vector3f p = track.point_in_world.cast<float>();
    cloud.push_back({{p.x(), p.y(), p.z()}, {0, 0, 0}, track.color, 0, 1.0f});
  }
  return cloud;
}

}  // namespace

void WriteSceneFiles(const fs::path& folder, const std::vector<SyntheticView>& views, float surface_spacing_m) {
  MakeFolder(folder);
  const std::vector<Track> tracks = FindTracks(views);
  const bool is_wide = !views.empty() && views.front().wide;
  if (is_wide) {
    MakeFolder(folder / "images");
    for (size_t i = 0; i < views.size(); ++i) WritePng(folder / "images" / ImageName(i), views[i].wide->color);
  } else {
    WriteMaps(folder, views);
    WriteMvsnetCameras(folder, views);
    WritePairs(folder, views);
  }
  WriteSparseModel(folder, views, tracks);
  WritePly(folder / "sparse.ply", CloudOf(tracks));
  WritePly(folder / "surface.ply", SampleSyntheticSurface(views, surface_spacing_m));
  if (is_wide) return;                                        // the list has pinhole cameras only
  WriteCameraList(folder / "cameras.txt", CamerasOf(views));  // last: a folder with this file is whole
}

}  // namespace acmp
