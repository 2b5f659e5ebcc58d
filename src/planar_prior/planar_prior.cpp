#include "acmp_mapping/planar_prior/planar_prior.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/planar_prior/kernel/planar_prior.h"
#include "acmp_mapping/planar_prior/kernel/support_grid.h"

namespace acmp {
namespace {

/// Plane through the triangle's vertices in 3D, facing the camera; all zero when it is degenerate or grazing.
PlaneHypothesis PlaneOfTriangle(const PinholeCamera& camera, const std::vector<SupportPoint>& points,
                                const SupportTriangle& triangle, double min_cos) {
  const auto corner = [&](int i) -> Eigen::Vector3d {
    const SupportPoint& point = points[triangle.vertex[i]];
    return camera.Unproject({point.col, point.row}, point.depth);
  };
  const Eigen::Vector3d p = corner(0), q = corner(1), r = corner(2);
  Eigen::Vector3d normal = (q - p).cross(r - p);
  const double doubled_area = normal.norm();
  const Eigen::Vector3d centroid = (p + q + r) / 3;
  if (!(doubled_area > 0) || !std::isfinite(doubled_area)) return {};
  normal /= doubled_area;
  if (normal.dot(centroid) > 0) normal = -normal;
  const double cos_to_ray = -normal.dot(centroid) / centroid.norm();
  if (!(cos_to_ray >= min_cos)) return {};
  // The plane's distance from the centroid: all vertices have the same say in the rounding.
  const Eigen::Vector4f plane(normal.x(), normal.y(), normal.z(), -normal.dot(centroid));
  return {plane[0], plane[1], plane[2], plane[3]};
}

void CheckDepths(const std::vector<SupportPoint>& points) {
  for (const SupportPoint& point : points) {
    if (point.depth > 0 && std::isfinite(point.depth)) continue;
    throw InvalidInputError(Concat("support point at pixel (", point.col, ", ", point.row, ") has depth ", point.depth,
                                   ": must be positive and finite"));
  }
}

constexpr int kBandRows = 32;  ///< that one task fills

void FindSupportPointsOfCells(const ImageView<const float>& depth, const ImageView<const float>& cost,
                              const DepthRange& range, const PlanarPriorOptions& options,
                              const ImageView<SupportPoint>& cells) {
  ForEachPixel(cells.width, cells.height, [&](int col, int row) {
    cells(col, row) = FindSupportPointOfCell(depth, cost, range.min, range.max, options.max_support_cost,
                                             options.cell_size_px, col, row);
  });
}

}  // namespace

std::vector<SupportPoint> FindSupportPoints(ImageView<const float> depth, ImageView<const float> cost,
                                            const DepthRange& range, const PlanarPriorOptions& options) {
  CheckDepthRange("depth range of the support points", range);
  const int size = options.cell_size_px;
  Image<SupportPoint> cells(CellsOf(depth.width, size), CellsOf(depth.height, size));
  FindSupportPointsOfCells(depth, cost, range, options, cells.View());
  std::vector<SupportPoint> points;
  std::copy_if(cells.begin(), cells.end(), std::back_inserter(points),
               [](const SupportPoint& point) { return point.depth > 0; });
  return points;
}

PriorMesh MakePriorMesh(const PinholeCamera& camera, const std::vector<SupportPoint>& points,
                        const PlanarPriorOptions& options) {
  CheckCamera("camera of the planar prior", camera);
  CheckDepths(points);
  const std::vector<SupportTriangle> triangles = TriangulateSupportPoints(points);
  const double min_cos = MinPriorCosine(options);
  PriorMesh mesh;
  mesh.triangles.resize(triangles.size());
  mesh.planes.resize(triangles.size());
  tbb::parallel_for(size_t{0}, triangles.size(), [&](size_t i) {
    for (int k = 0; k < 3; ++k) {
      const SupportPoint& point = points[static_cast<size_t>(triangles[i].vertex[k])];
      mesh.triangles[i].col[k] = point.col;
      mesh.triangles[i].row[k] = point.row;
    }
    mesh.planes[i] = PlaneOfTriangle(camera, points, triangles[i], min_cos);
  });
  return mesh;
}

Image<uint32_t> RasterizePrior(const PinholeCamera& camera, const PriorMesh& mesh, const DepthRange& range) {
  CheckCamera("camera of the planar prior", camera);
  CheckDepthRange("depth range of the planar prior", range);
  CheckRange("number of planes of the prior", mesh.planes.size(), mesh.triangles.size(), mesh.triangles.size());
  const RayGrid rays = MakeRayGrid(camera);
  Image<uint32_t> numbers(camera.width, camera.height, 0);
  // Each task owns its rows.
  tbb::parallel_for(0, (camera.height + kBandRows - 1) / kBandRows, [&](int band) {
    const int band_begin = band * kBandRows, band_end = std::min(band_begin + kBandRows, camera.height);
    for (size_t i = 0; i < mesh.triangles.size(); ++i) {
      const int* rows = mesh.triangles[i].row;
      const auto [low, high] = std::minmax({rows[0], rows[1], rows[2]});
      if (high < band_begin || low >= band_end) continue;
      const RasterTriangle triangle = MakeRasterTriangle(mesh.triangles[i]);
      for (int row = std::max(band_begin, low); row < std::min(band_end, high + 1); ++row) {
        const ColumnSpan span = SpanOfRow(triangle, row, camera.width);
        for (int col = span.first; col <= span.last; ++col) {
          // The same float arithmetic as the matching passes: what passes here is in range there. NaN (zero plane)
          // fails.
          const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
          const float depth = PlaneDepth(mesh.planes[i], ray);
          if (depth >= range.min && depth <= range.max) numbers(col, row) = static_cast<uint32_t>(i) + 1;
        }
      }
    }
  });
  return numbers;
}

PriorMesh MakeGridMesh(const PinholeCamera& camera, ImageView<const float> depth, ImageView<const float> cost,
                       const DepthRange& range, const PlanarPriorOptions& options) {
  CheckCamera("camera of the planar prior", camera);
  CheckDepthRange("depth range of the planar prior", range);
  CheckSize("depth map", depth.width, depth.height, camera);
  CheckSize("cost map", cost.width, cost.height, camera);
  const int size = options.cell_size_px, cols = CellsOf(camera.width, size), rows = CellsOf(camera.height, size);
  Image<SupportPoint> points(cols, rows), flooded(cols, rows);
  FindSupportPointsOfCells(depth, cost, range, options, points.View());
  for (int step = FirstFloodingStep(cols, rows); step > 0; step /= 2) {
    ForEachPixel(cols, rows,
                 [&](int col, int row) { flooded(col, row) = FloodCell(points.View(), size, step, col, row); });
    std::swap(points, flooded);
  }
  PriorMesh mesh;
  mesh.triangles.resize(2 * points.size());
  mesh.planes.resize(2 * points.size());
  const SupportGrid grid = {size, points.View(), flooded.View(), mesh.triangles.data(), mesh.planes.data()};
  const RayGrid rays = MakeRayGrid(camera);
  const auto min_cosine = static_cast<float>(MinPriorCosine(options));
  ForEachPixel(cols, rows, [&](int col, int row) { SetTrianglesOfGroup(grid, rays, min_cosine, col, row); });
  return mesh;
}

double MinPriorCosine(const PlanarPriorOptions& options) {
  return std::cos(options.max_grazing_angle_deg * kRadPerDeg<double>);
}

}  // namespace acmp
