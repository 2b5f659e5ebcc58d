#include "acmp_mapping/synthetic/synthetic_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <set>
#include <unordered_set>
#include <utility>

#include <tbb/parallel_for.h>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/voxel.h"
#include "world.h"

namespace acmp {
namespace {

constexpr int kRaysPerSide = 4;           // per pixel and axis: textures are averaged over the pixel's area
constexpr double kFirstStamp_s = 1000.0;  // not 0, which means "no stamp"
constexpr double kKeyframeInterval_s = 0.5;
constexpr int kMaxKeyframes = 1000;

const SyntheticWorld& WorldOf(SyntheticPlace place) {
  static const SyntheticWorld room = MakeRoom(), office = MakeOffice(), street = MakeStreet();
  return place == SyntheticPlace::kRoom ? room : place == SyntheticPlace::kOffice ? office : street;
}

// A global-shutter CMOS camera in lamp light, held by hand.
ImagingModel IndoorVideoCamera() {
  ImagingModel model;
  // Pixels of 3.45 um hold about 10 500 electrons and read with 2.5 electrons of noise (EMVA 1288 data of common
  // sensors). Lamp light at 1/60 s fills a quarter: 12 dB of gain, white (255) at 2600 electrons.
  model.grey_per_electron = 255.0 / 2600.0;
  model.read_noise_grey = 2.5 * model.grey_per_electron;
  // Interpolating the Bayer pattern (taps 1/4, 1/2, 1/4) alone has 0.71.
  model.psf_sigma_px = 0.7;
  // 15 degrees per second, a camera moved by hand without haste, at 1/60 s.
  model.shake_deg = 0.25;
  // An automatic exposure that follows what is in view, 0.6 steps up or down: 0.67 to 1.5.
  model.exposure_spread = 0.2;
  model.vignetting = true;
  return model;
}

// The same kind of camera on a vehicle by day.
ImagingModel DaylightCamera() {
  ImagingModel model = IndoorVideoCamera();
  model.grey_per_electron = 255.0 / 10500.0;  // the wells are full at white
  model.read_noise_grey = 2.5 * model.grey_per_electron;
  model.shake_deg = 0.02;  // 20 degrees per second at 1/1000 s
  model.exposure_spread = 0.1;
  return model;
}

// A camera at the same place whose axes are the columns of `turn` in those of `pose`.
CameraPose TurnedTo(const Eigen::Matrix3d& turn, const CameraPose& pose) {
  const auto axis = [&](int i) { return turn(0, i) * pose.right + turn(1, i) * pose.down + turn(2, i) * pose.forward; };
  return {pose.center, axis(0), axis(1), axis(2)};
}

// The renderer's input for one image.
struct Shot {
  const SyntheticWorld& world;
  const ImagingModel& imaging;
  PinholeCamera camera;
  uint32_t seed;
  std::vector<CameraPose> poses;  ///< one per ray of a pixel
  double margin_m;                ///< no ray of a pixel is farther from the one through its centre
};

// Half a pixel's diagonal at the far end of the room.
double PixelMargin(const PinholeCamera& camera, double diameter_m) {
  return 0.71 * diameter_m / std::min(camera.fx, camera.fy);
}

// Moment of the exposure at which each ray of a pixel is cast, of kRaysPerSide^2 (Bayer's matrix for ordered
// dithering): every part of the pixel is sampled early and late.
constexpr int kMoments[kRaysPerSide][kRaysPerSide] = {{0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}};

ColorD PixelLight(const Shot& shot, const CameraPose& pose, int col, int row) {
  const std::vector<size_t> objects = ObjectsNear(shot.world, PixelRay(shot.camera, pose, col, row), shot.margin_m);
  ColorD sum = {0, 0, 0};
  for (int j = 0; j < kRaysPerSide; ++j) {
    for (int i = 0; i < kRaysPerSide; ++i) {
      const double u = col + (i + 0.5) / kRaysPerSide - 0.5;
      const double v = row + (j + 0.5) / kRaysPerSide - 0.5;
      const Ray ray = PixelRay(shot.camera, shot.poses[kMoments[j][i]], u, v);
      const ColorD color = LitColor(shot.world, Trace(shot.world, ray, &objects), ray, shot.seed);
      sum = {sum.r + color.r, sum.g + color.g, sum.b + color.b};
    }
  }
  constexpr double kShare = 1.0 / (kRaysPerSide * kRaysPerSide);
  return {kShare * sum.r, kShare * sum.g, kShare * sum.b};
}

// The light on the sensor, 0..255 at exposure 1.
Image<ColorD> RenderLight(const Shot& shot, const CameraPose& pose) {
  const int border = PsfBorder(shot.imaging);
  Image<ColorD> light(shot.camera.width + 2 * border, shot.camera.height + 2 * border);
  ForEachPixel(light.width(), light.height(),
               [&](int col, int row) { light(col, row) = PixelLight(shot, pose, col - border, row - border); });
  return BlurByPsf(shot.imaging, std::move(light));
}

Vec3f DirectionInCamera(const CameraPose& pose, const Vec3d& v) {
  return {static_cast<float>(Dot(pose.right, v)), static_cast<float>(Dot(pose.down, v)),
          static_cast<float>(Dot(pose.forward, v))};
}

float DepthOf(const WorldHit& hit) { return hit.sky ? 0.0f : static_cast<float>(hit.where.t); }

void RenderGeometry(const Shot& shot, Rendering* out) {
  ForEachPixel(shot.camera.width, shot.camera.height, [&](int col, int row) {
    const WorldHit hit = Trace(shot.world, PixelRay(shot.camera, out->pose, col, row));
    out->low_texture(col, row) = hit.low_texture ? 1 : 0;
    out->labels(col, row) = LabelOf(shot.world, hit);
    out->depth(col, row) = DepthOf(hit);
    out->normal(col, row) = hit.sky ? Vec3f{0, 0, 0} : DirectionInCamera(out->pose, hit.where.normal);
  });
}

/// @param picture number of the draws of noise
void TakePicture(const Shot& shot, int picture, Rendering* out) {
  const Image<ColorD> light = RenderLight(shot, out->pose);
  ForEachPixel(shot.camera.width, shot.camera.height, [&](int col, int row) {
    const double factor = out->exposure * VignettingAt(shot.imaging, shot.camera, col, row);
    const ColorD& c = light(col, row);
    RandomStream random(shot.seed, static_cast<uint32_t>(row * shot.camera.width + col),
                        static_cast<uint32_t>(picture));
    out->color(col, row) = Digitize(shot.imaging, {factor * c.r, factor * c.g, factor * c.b}, &random);
  });
}

/// @param right_m how far to the right of the first camera
Rendering Render(const SyntheticWorld& world, const PinholeFace& face, int index, const SyntheticSceneOptions& options,
                 double right_m) {
  const PinholeCamera& camera = face.camera;
  const int place = options.standing ? options.keyframes / 2 : index;
  const int picture = right_m > 0 ? kMaxKeyframes + index : index;
  CameraPose pose = TurnedTo(face.lens_from_face, PoseOnPath(world.path, place, options.keyframes, options.seed));
  pose.center = pose.center + right_m * pose.right;
  Rendering out = {camera, pose, ExposureOf(options.imaging, options.seed, index)};
  const Shot shot = {world,
                     options.imaging,
                     camera,
                     options.seed,
                     PosesDuringExposure(options.imaging, out.pose, options.seed, index, kRaysPerSide * kRaysPerSide),
                     PixelMargin(camera, world.diameter_m) + world.diameter_m * LargestTurn(options.imaging)};
  RenderGeometry(shot, &out);
  if (!options.moving_object) {
    TakePicture(shot, picture, &out);
    return out;
  }
  const SyntheticWorld with_object = WithMovingObject(world, index, options);
  const Shot with = {with_object, shot.imaging, shot.camera, shot.seed, shot.poses, shot.margin_m};
  TakePicture(with, picture, &out);
  out.shown_depth = DepthMap(camera.width, camera.height);
  ForEachPixel(camera.width, camera.height, [&](int col, int row) {
    out.shown_depth(col, row) = DepthOf(Trace(with_object, PixelRay(camera, out.pose, col, row)));
  });
  out.mask = MaskOfLastObject(with_object, camera, out.pose, options.imaging);
  return out;
}

RigidTransform CamFromWorld(const CameraPose& pose) {
  RigidTransform transform = RigidTransform::Identity();
  const Vec3d axes[3] = {pose.right, pose.down, pose.forward};
  for (int i = 0; i < 3; ++i) {
    transform.matrix().row(i) << axes[i].x, axes[i].y, axes[i].z, -Dot(axes[i], pose.center);
  }
  return transform;
}

CameraPose PoseOf(const RigidTransform& cam_from_world) {
  const RigidTransform world_from_cam = cam_from_world.inverse();
  const auto column = [&](int i) {
    return Vec3d{world_from_cam.matrix()(0, i), world_from_cam.matrix()(1, i), world_from_cam.matrix()(2, i)};
  };
  return {column(3), column(0), column(1), column(2)};
}

SurfacePoint SurfacePointAt(const Ray& ray, const WorldHit& hit, const Rgb& color, Label label) {
  const Vec3d p = ray.origin + hit.where.t * ray.direction;
  const Vec3d& n = hit.where.normal;
  return {{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)},
          {static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)},
          color,
          label,
          1.0f};
}

// Points seen in one row of pixels, `rays` x `rays` per pixel.
PointCloud SampleRow(const SyntheticView& view, const CameraPose& pose, int row, int rays) {
  const SyntheticWorld& world = WorldOf(view.place);
  const PinholeCamera& camera = view.frame.camera;
  const double margin_m = PixelMargin(camera, world.diameter_m);
  PointCloud points;
  points.reserve(static_cast<size_t>(camera.width) * rays * rays);
  for (int col = 0; col < camera.width; ++col) {
    const std::vector<size_t> objects = ObjectsNear(world, PixelRay(camera, pose, col, row), margin_m);
    for (int j = 0; j < rays; ++j) {
      for (int i = 0; i < rays; ++i) {
        const Ray ray = PixelRay(camera, pose, col + (i + 0.5) / rays - 0.5, row + (j + 0.5) / rays - 0.5);
        const WorldHit hit = Trace(world, ray, &objects);
        if (!hit.sky) points.push_back(SurfacePointAt(ray, hit, view.frame.color(col, row), LabelOf(world, hit)));
      }
    }
  }
  return points;
}

// Casts rays densely enough that neighbours on a surface facing the camera lie within half the spacing, and keeps the
// first point in each cell.
void SampleView(const SyntheticView& view, double spacing_m, std::unordered_set<Voxel, VoxelHash>* taken,
                PointCloud* cloud) {
  const PinholeCamera& camera = view.frame.camera;
  const CameraPose pose = PoseOf(view.frame.cam_from_world);
  const double max_depth = *std::max_element(view.true_depth.begin(), view.true_depth.end());
  const int rays = std::max(1, static_cast<int>(std::ceil(2.0 * max_depth / (camera.fx * spacing_m))));
  std::vector<PointCloud> rows(camera.height);
  tbb::parallel_for(0, camera.height, [&](int row) { rows[row] = SampleRow(view, pose, row, rays); });
  for (const PointCloud& row : rows) {
    for (const SurfacePoint& point : row) {
      if (taken->insert(VoxelOf(point.position, spacing_m, 0.0)).second) cloud->push_back(point);
    }
  }
}

// The faces of a wide image, finer than it is: it is interpolated in them.
std::vector<PinholeFace> FacesToRender(const Lens& lens) {
  constexpr double kFiner = 1.5;
  std::vector<PinholeFace> faces = FacesOf(lens);
  for (PinholeFace& face : faces) {
    face.camera = face.camera.Resized(static_cast<int>(kFiner * face.camera.width),
                                      static_cast<int>(kFiner * face.camera.height));
  }
  return faces;
}

// Bilinear; false where the pixel is not in the image.
bool Interpolate(const ColorImage& image, const Eigen::Vector2d& pixel, Rgb* color) {
  if (!(pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < image.width() - 1 && pixel.y() < image.height() - 1))
    return false;
  const int col = static_cast<int>(pixel.x()), row = static_cast<int>(pixel.y());
  const double x = pixel.x() - col, y = pixel.y() - row;
  const auto mix = [&](unsigned char Rgb::*c) {
    const double above = (1 - x) * (image(col, row).*c) + x * (image(col + 1, row).*c);
    const double below = (1 - x) * (image(col, row + 1).*c) + x * (image(col + 1, row + 1).*c);
    return static_cast<unsigned char>(std::floor((1 - y) * above + y * below + 0.5));
  };
  *color = {mix(&Rgb::r), mix(&Rgb::g), mix(&Rgb::b)};
  return true;
}

// Makes view->wide of the view and the others.
void TakeWideImage(const std::vector<PinholeFace>& faces, SyntheticView* view) {
  SyntheticWideImage& wide = *view->wide;
  std::vector<const SyntheticView*> views = {view};
  for (const SyntheticView& other : wide.others) views.push_back(&other);
  const PinholeCamera& camera = wide.lens.camera();
  wide.color = ColorImage(camera.width, camera.height);
  ForEachPixel(camera.width, camera.height, [&](int col, int row) {
    const auto ray = wide.lens.Unproject({static_cast<double>(col), static_cast<double>(row)});
    for (size_t i = 0; ray && i < faces.size(); ++i) {
      const Eigen::Vector3d in_face = faces[i].lens_from_face.transpose() * *ray;
      if (in_face.z() < in_face.cwiseAbs().maxCoeff()) continue;
      if (Interpolate(views[i]->frame.color, faces[i].camera.Project(in_face), &wide.color(col, row))) break;
    }
  });
  std::set<std::array<double, 3>> known;
  for (const SyntheticView* seen : views) {
    for (const Eigen::Vector3d& point : seen->frame.landmarks_in_world) {
      if (known.insert({point.x(), point.y(), point.z()}).second) wide.landmarks_in_world.push_back(point);
    }
  }
}

// Its circle fills the shorter side of the image.
Lens SyntheticFisheye(const SyntheticSceneOptions& options) {
  CheckRange("field of view", options.field_of_view, kWideFieldOfView + 1, 240.0);
  const double radius_px = 0.5 * std::min(options.width, options.height);
  const double focal = radius_px / (0.5 * kRadPerDeg<double> * options.field_of_view);
  const PinholeCamera camera = {
      options.width, options.height, focal, focal, 0.5 * (options.width - 1), 0.5 * (options.height - 1)};
  return {camera, {LensDistortion::Model::kEquidistant, {-0.01, 0.004, -0.001, 1e-4}}, options.field_of_view};
}

}  // namespace

void SelectSyntheticScene(const std::string& name, SyntheticSceneOptions* options) {
  if (name == "room") {
    options->place = SyntheticPlace::kRoom;
    options->imaging = {};
  } else if (name == "hard") {
    options->place = SyntheticPlace::kOffice;
    options->imaging = IndoorVideoCamera();
  } else if (name == "street") {
    options->place = SyntheticPlace::kStreet;
    options->imaging = DaylightCamera();
  } else {
    throw InvalidInputError(Concat("scene = \"", name, "\": must be one of room, hard, street"));
  }
}

std::vector<SyntheticView> MakeSyntheticScene(const SyntheticSceneOptions& options) {
  constexpr int kMinSize = 32, kMaxSize = 8192;
  CheckRange("width", options.width, kMinSize, kMaxSize);
  CheckRange("height", options.height, kMinSize, kMaxSize);
  CheckRange("keyframes", options.keyframes, 2, kMaxKeyframes);
  CheckRange("stereo baseline", options.stereo_baseline_m, 0.0, 5.0);
  CheckRange("read_noise_grey", options.imaging.read_noise_grey, 0.0, 50.0);
  if (options.field_of_view != 0 && options.stereo_baseline_m > 0) {
    throw InvalidInputError("a synthetic fisheye has no second camera: either field of view or stereo baseline");
  }

  const SyntheticWorld& world = WorldOf(options.place);
  std::optional<Lens> lens;
  std::vector<PinholeFace> faces = {{"", SyntheticCamera(options.width, options.height)}};
  if (options.field_of_view != 0) {
    lens = SyntheticFisheye(options);
    faces = FacesToRender(*lens);
  }
  std::vector<Rendering> renderings;
  for (int i = 0; i < options.keyframes; ++i) {
    for (const PinholeFace& face : faces) renderings.push_back(Render(world, face, i, options, 0));
  }
  std::vector<std::vector<Eigen::Vector3d>> landmarks = MakeLandmarks(world, renderings, options.seed);

  std::vector<SyntheticView> views;
  for (size_t i = 0; i < renderings.size(); ++i) {
    Rendering& r = renderings[i];
    const auto index = static_cast<int>(i / faces.size());
    SyntheticView view;
    view.frame = MakeFrame(index, kFirstStamp_s + kKeyframeInterval_s * index, std::move(r.color), r.camera,
                           CamFromWorld(r.pose), std::move(landmarks[i]), {}, r.mask);
    view.true_depth = std::move(r.depth);
    view.true_normal = std::move(r.normal);
    view.low_texture = std::move(r.low_texture);
    view.true_labels = std::move(r.labels);
    view.place = options.place;
    view.shown_depth = std::move(r.shown_depth);
    if (options.stereo_baseline_m > 0) {
      Rendering right = Render(world, faces.front(), index, options, options.stereo_baseline_m);
      view.right =
          MakeFrame(index, view.frame.stamp_s, std::move(right.color), right.camera, CamFromWorld(right.pose), {});
    }
    if (i % faces.size() > 0) {
      views.back().wide->others.push_back(std::move(view));
    } else {
      if (lens) view.wide = SyntheticWideImage{*lens, {}, {}, {}};
      views.push_back(std::move(view));
    }
  }
  for (SyntheticView& view : views) {
    if (lens) TakeWideImage(faces, &view);
  }
  return views;
}

void CheckSurfaceSpacing(float spacing_m) { CheckRange("spacing_m", spacing_m, 0.001f, 1.0f); }

PointCloud SampleSyntheticSurface(const std::vector<SyntheticView>& views, float spacing_m) {
  CheckSurfaceSpacing(spacing_m);
  PointCloud cloud;
  std::unordered_set<Voxel, VoxelHash> taken;
  for (const SyntheticView& view : views) {
    SampleView(view, spacing_m, &taken, &cloud);
    if (!view.wide) continue;
    for (const SyntheticView& other : view.wide->others) SampleView(other, spacing_m, &taken, &cloud);
  }
  return cloud;
}

}  // namespace acmp
