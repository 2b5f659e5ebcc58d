#include "acmp_mapping/mesh/splat_points.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/fusion/voxel_map.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <vector>

namespace acmp {
namespace {

constexpr float kMaxTangent = 3.7f;   ///< of 75 degrees
constexpr int kMaxSize = 4096;        ///< px
constexpr double kHalfSquare = 0.75;  ///< spacings: squares overlap, so that there are no gaps between them
constexpr double kMaxDrawn = 200;     ///< times that a pixel is drawn, on average; 2 to 20 of what cameras see

bool IsInView(const Vec3f& p) { return p.z > 0 && std::max(std::abs(p.x), std::abs(p.y)) <= kMaxTangent * p.z; }

/// Of the points before the camera: depths, and the box around x and y at z = 1.
struct PointExtent {
  std::vector<float> depths;
  Eigen::AlignedBox2f box;
};

PointExtent PointExtentOf(const PointCloud& points) {
  PointExtent extent;
  for (const SurfacePoint& point : points) {
    const Vec3f& p = point.position;
    if (!(p.z > 0)) continue;
    extent.depths.push_back(p.z);
    extent.box.extend(Eigen::Vector2f(p.x / p.z, p.y / p.z));
  }
  return extent;
}

/// Throws nothing; `points` are in view and at least one.
PinholeCamera CameraAround(const PointCloud& points, double spacing) {
  const PointExtent extent = PointExtentOf(points);
  const Eigen::Vector2d size = extent.box.sizes().cast<double>(), low = extent.box.min().cast<double>();
  const double focal = std::min(Median(extent.depths) / spacing, (kMaxSize - 2) / std::max(size.maxCoeff(), 1e-9));
  return {static_cast<int>(std::ceil(focal * size.x())) + 1,
          static_cast<int>(std::ceil(focal * size.y())) + 1,
          focal,
          focal,
          -focal * low.x(),
          -focal * low.y()};
}

/// Draws points into maps; of the squares that cover a pixel the one whose middle is nearest stays.
class Splatter {
 public:
  Splatter(double spacing, SurfaceMaps* maps)
      : spacing_(spacing),
        maps_(*maps),
        camera_(maps->camera.camera),
        distances_(camera_.width, camera_.height, std::numeric_limits<float>::max()) {}

  void Draw(const SurfacePoint& point) {
    const Square square = SquareOf(point);
    for (int row = square.rows[0]; row <= square.rows[1]; ++row) {
      for (int col = square.cols[0]; col <= square.cols[1]; ++col) {
        DrawPixel(point, static_cast<float>((Eigen::Vector2d(col, row) - square.middle).squaredNorm()), col, row);
      }
    }
  }

  /// Pixels that it is drawn over.
  double Count(const SurfacePoint& point) const {
    const Square square = SquareOf(point);
    return std::max(0.0, 1.0 + square.rows[1] - square.rows[0]) * std::max(0.0, 1.0 + square.cols[1] - square.cols[0]);
  }

 private:
  struct Square {
    Eigen::Vector2d middle;
    int cols[2], rows[2];  ///< the first and the last
  };
  Square SquareOf(const SurfacePoint& point) const {
    const Eigen::Vector3d position(point.position.x, point.position.y, point.position.z);
    const Eigen::Vector2d middle = camera_.Project(position);
    const double reach = std::max(kHalfSquare, kHalfSquare * spacing_ * camera_.fx / position.z());
    return {middle,
            {First(middle.x(), reach, camera_.width), Last(middle.x(), reach, camera_.width)},
            {First(middle.y(), reach, camera_.height), Last(middle.y(), reach, camera_.height)}};
  }
  static int First(double middle, double reach, int size) {
    return static_cast<int>(std::clamp<double>(std::ceil(middle - reach), 0, size));
  }
  static int Last(double middle, double reach, int size) {
    return static_cast<int>(std::clamp<double>(std::floor(middle + reach), -1, size - 1));
  }

  void DrawPixel(const SurfacePoint& point, float distance, int col, int row) {
    if (distance >= distances_(col, row)) return;
    const Eigen::Vector3d ray = camera_.Unproject({col, row});
    const Vec3f direction = {static_cast<float>(ray.x()), static_cast<float>(ray.y()), 1.0f};
    const float depth = PlaneDepth(
        PlaneThrough(point.normal, {point.position.x / point.position.z, point.position.y / point.position.z, 1.0f},
                     point.position.z),
        direction);
    // Not where a plane that is seen from its edge leads far away.
    constexpr double kMaxOffset = 3;  // spacings
    if (!(depth > 0) || !(std::abs(depth - point.position.z) <= kMaxOffset * spacing_)) return;
    distances_(col, row) = distance;
    maps_.depth(col, row) = depth;
    maps_.normal(col, row) = point.normal;
    maps_.confidence(col, row) = point.confidence;
    maps_.color(col, row) = point.color;
  }

  const double spacing_;
  SurfaceMaps& maps_;
  const PinholeCamera& camera_;
  Image<float> distances_;  ///< px^2, of the middle of the square that a pixel has
};

PointCloud PointsInView(const PointCloud& points) {
  PointCloud in_view;
  std::copy_if(points.begin(), points.end(), std::back_inserter(in_view),
               [](const SurfacePoint& point) { return IsInView(point.position); });
  return in_view;
}

SurfaceMaps DrawInView(const PointCloud& points, const PosedCamera& camera, double spacing) {
  const int width = camera.camera.width, height = camera.camera.height;
  SurfaceMaps maps;
  maps.camera = camera;
  maps.depth = DepthMap(width, height);
  maps.normal = NormalMap(width, height);
  maps.confidence = ConfidenceMap(width, height);
  maps.color = ColorImage(width, height);
  Splatter splatter(spacing, &maps);
  // Points that are not `spacing` apart, near the camera, would all be drawn over the whole image.
  double pixels = 0;
  for (const SurfacePoint& point : points) pixels += splatter.Count(point);
  const bool is_dense = pixels > kMaxDrawn * static_cast<double>(maps.depth.size());
  for (const SurfacePoint& point : is_dense ? VoxelFilter(points, static_cast<float>(spacing)) : points) {
    splatter.Draw(point);
  }
  return maps;
}

}  // namespace

SurfaceMaps SplatPoints(const PointCloud& points_in_camera, const RigidTransform& world_from_cam, double spacing) {
  const PointCloud in_view = PointsInView(points_in_camera);
  if (in_view.empty()) return {};
  return DrawInView(in_view, {CameraAround(in_view, spacing), world_from_cam.inverse()}, spacing);
}

SurfaceMaps SplatPoints(const PointCloud& points_in_camera, const PosedCamera& camera, double spacing) {
  const PosedCamera drawn = {SplatCamera(camera.camera, points_in_camera.size()), camera.cam_from_world};
  return DrawInView(PointsInView(points_in_camera), drawn, spacing);
}

PinholeCamera SplatCamera(const PinholeCamera& camera, size_t points) {
  constexpr double kPerPoint = 64, kLeast = 640 * 480;  // px
  const double shrink = std::sqrt(static_cast<double>(camera.width) * camera.height /
                                  std::max(kLeast, kPerPoint * static_cast<double>(points)));
  if (!(shrink > 1)) return camera;
  const auto side = [shrink](int px) { return std::max(1, static_cast<int>(px / shrink)); };
  return camera.Resized(side(camera.width), side(camera.height));
}

double PointSpacing(const PointCloud& points_in_camera, double voxel_size) {
  constexpr double kHalfCovered = 0.7;  // of the box around them points cover half or more
  const auto [depths, box] = PointExtentOf(points_in_camera);
  if (depths.empty()) return 0;
  return std::max(voxel_size,
                  kHalfCovered * Median(depths) * std::sqrt(box.volume() / static_cast<double>(depths.size())));
}

}  // namespace acmp
