#include "acmp_mapping/evaluation/synthetic_scene.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_set>
#include <utility>

#include <tbb/parallel_for.h>

#include "acmp_mapping/common/error.h"
#include "synthetic_landmarks.h"
#include "synthetic_room.h"

namespace acmp {
namespace {

constexpr int kRaysPerSide = 4;           // per pixel and axis: textures are averaged over the pixel's area
constexpr double kFirstStamp_s = 1000.0;  // not 0, which means "no stamp"
constexpr double kKeyframeInterval_s = 0.5;

// A view before it becomes a Frame.
struct Rendering {
  CameraPose pose;
  ColorImage color;
  DepthMap depth;
  NormalMap normal;
  Image<unsigned char> low_texture;
};

unsigned char Quantize(double value) {
  return static_cast<unsigned char>(std::floor(std::clamp(value, 0.0, 255.0) + 0.5));
}

// Half a pixel's diagonal at the far end of the room.
double PixelMargin(const PinholeCamera& camera) { return 0.71 * kRoomDiameter_m / std::min(camera.fx, camera.fy); }

ColorD PixelColor(const PinholeCamera& camera, const CameraPose& pose, int col, int row, uint32_t seed) {
  const std::vector<size_t> objects = ObjectsNear(PixelRay(camera, pose, col, row), PixelMargin(camera));
  ColorD sum = {0, 0, 0};
  for (int j = 0; j < kRaysPerSide; ++j) {
    for (int i = 0; i < kRaysPerSide; ++i) {
      const double u = col + (i + 0.5) / kRaysPerSide - 0.5;
      const double v = row + (j + 0.5) / kRaysPerSide - 0.5;
      const Ray ray = PixelRay(camera, pose, u, v);
      const ColorD color = RoomColor(TraceRoom(ray, objects), ray, seed);
      sum = {sum.r + color.r, sum.g + color.g, sum.b + color.b};
    }
  }
  constexpr double kShare = 1.0 / (kRaysPerSide * kRaysPerSide);
  return {kShare * sum.r, kShare * sum.g, kShare * sum.b};
}

Vec3f DirectionInCamera(const CameraPose& pose, const Vec3d& v) {
  return {static_cast<float>(Dot(pose.right, v)), static_cast<float>(Dot(pose.down, v)),
          static_cast<float>(Dot(pose.forward, v))};
}

void RenderRow(const PinholeCamera& camera, int row, int index, const SyntheticSceneOptions& options, Rendering* out) {
  for (int col = 0; col < camera.width; ++col) {
    const RoomHit hit = TraceRoom(PixelRay(camera, out->pose, col, row));
    out->depth(col, row) = static_cast<float>(hit.where.t);
    out->normal(col, row) = DirectionInCamera(out->pose, hit.where.normal);
    out->low_texture(col, row) = hit.low_texture ? 1 : 0;
    const ColorD color = PixelColor(camera, out->pose, col, row, options.seed);
    RandomStream random(options.seed, static_cast<uint32_t>(row * camera.width + col), static_cast<uint32_t>(index));
    // Braces fix the order of the three draws.
    const double noise[3] = {BellNoise(&random, options.noise_grey), BellNoise(&random, options.noise_grey),
                             BellNoise(&random, options.noise_grey)};
    out->color(col, row) = {Quantize(color.r + noise[0]), Quantize(color.g + noise[1]), Quantize(color.b + noise[2])};
  }
}

Rendering Render(const PinholeCamera& camera, int index, const SyntheticSceneOptions& options) {
  Rendering out;
  out.pose = HandHeldPose(index, options.keyframes, options.seed);
  out.color = ColorImage(camera.width, camera.height);
  out.depth = DepthMap(camera.width, camera.height);
  out.normal = NormalMap(camera.width, camera.height);
  out.low_texture = Image<unsigned char>(camera.width, camera.height);
  tbb::parallel_for(0, camera.height, [&](int row) { RenderRow(camera, row, index, options, &out); });
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

// Key of a grid cell; 21 bits per axis hold +-1 km at the smallest spacing.
uint64_t CellKey(const Vec3f& point, double cell_m) {
  const auto part = [&](double x) {
    return static_cast<uint64_t>(static_cast<int64_t>(std::floor(x / cell_m)) & 0x1fffff);
  };
  return part(point.x) << 42 | part(point.y) << 21 | part(point.z);
}

SurfacePoint SurfacePointAt(const Ray& ray, const RoomHit& hit, const Rgb& color) {
  const Vec3d p = ray.origin + hit.where.t * ray.direction;
  const Vec3d& n = hit.where.normal;
  return {{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)},
          {static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)},
          color,
          1.0f};
}

// Points seen in one row of pixels, `rays` x `rays` per pixel.
PointCloud SampleRow(const SyntheticView& view, const CameraPose& pose, int row, int rays) {
  const PinholeCamera& camera = view.frame.camera;
  PointCloud points;
  points.reserve(static_cast<size_t>(camera.width) * rays * rays);
  for (int col = 0; col < camera.width; ++col) {
    const std::vector<size_t> objects = ObjectsNear(PixelRay(camera, pose, col, row), PixelMargin(camera));
    for (int j = 0; j < rays; ++j) {
      for (int i = 0; i < rays; ++i) {
        const Ray ray = PixelRay(camera, pose, col + (i + 0.5) / rays - 0.5, row + (j + 0.5) / rays - 0.5);
        points.push_back(SurfacePointAt(ray, TraceRoom(ray, objects), view.frame.color(col, row)));
      }
    }
  }
  return points;
}

// Casts rays densely enough that neighbours on a surface facing the camera lie within half the spacing, and keeps the
// first point in each cell.
void SampleView(const SyntheticView& view, double spacing_m, std::unordered_set<uint64_t>* taken, PointCloud* cloud) {
  const PinholeCamera& camera = view.frame.camera;
  const CameraPose pose = PoseOf(view.frame.cam_from_world);
  const double max_depth = *std::max_element(view.true_depth.begin(), view.true_depth.end());
  const int rays = std::max(1, static_cast<int>(std::ceil(2.0 * max_depth / (camera.fx * spacing_m))));
  std::vector<PointCloud> rows(camera.height);
  tbb::parallel_for(0, camera.height, [&](int row) { rows[row] = SampleRow(view, pose, row, rays); });
  for (const PointCloud& row : rows) {
    for (const SurfacePoint& point : row) {
      if (taken->insert(CellKey(point.position, spacing_m)).second) cloud->push_back(point);
    }
  }
}

}  // namespace

std::vector<SyntheticView> MakeSyntheticScene(const SyntheticSceneOptions& options) {
  constexpr int kMinSize = 32, kMaxSize = 8192;
  CheckRange("width", options.width, kMinSize, kMaxSize);
  CheckRange("height", options.height, kMinSize, kMaxSize);
  CheckRange("keyframes", options.keyframes, 2, 1000);
  CheckRange("noise_grey", options.noise_grey, 0.0, 50.0);

  const PinholeCamera camera = RoomCamera(options.width, options.height);
  std::vector<Rendering> renderings(options.keyframes);
  for (int i = 0; i < options.keyframes; ++i) renderings[i] = Render(camera, i, options);

  std::vector<LandmarkView> landmark_views;
  landmark_views.reserve(renderings.size());
  for (const Rendering& r : renderings) landmark_views.push_back({camera, r.pose, &r.color, &r.depth, &r.low_texture});
  std::vector<std::vector<Eigen::Vector3d>> landmarks = MakeLandmarks(landmark_views, options.seed);

  std::vector<SyntheticView> views(options.keyframes);
  for (int i = 0; i < options.keyframes; ++i) {
    Rendering& r = renderings[i];
    views[i].frame = MakeFrame(i, kFirstStamp_s + kKeyframeInterval_s * i, std::move(r.color), camera,
                               CamFromWorld(r.pose), std::move(landmarks[i]), 0);
    views[i].true_depth = std::move(r.depth);
    views[i].true_normal = std::move(r.normal);
    views[i].low_texture = std::move(r.low_texture);
  }
  return views;
}

PointCloud SampleSyntheticSurface(const std::vector<SyntheticView>& views, float spacing_m) {
  CheckRange("spacing_m", spacing_m, 0.001f, 1.0f);
  PointCloud cloud;
  std::unordered_set<uint64_t> taken;
  for (const SyntheticView& view : views) SampleView(view, spacing_m, &taken, &cloud);
  return cloud;
}

}  // namespace acmp
