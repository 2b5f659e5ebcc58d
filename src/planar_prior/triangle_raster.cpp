#include <tbb/parallel_for.h>

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/planar_prior/kernel/raster_triangle.h"
#include "acmp_mapping/planar_prior/planar_prior.h"
#include "check_triangles.h"

namespace acmp {
namespace {

/// Keeps every edge function below 2^63: differences < 2^29, products with pixels < 2^60, three of them summed.
constexpr int kMaxCoordinate = 1 << 28;
constexpr int kBandRows = 32;  ///< that one task fills

TriangleCorners CornersOf(const std::vector<SupportPoint>& points, const SupportTriangle& triangle) {
  TriangleCorners corners;
  for (int i = 0; i < 3; ++i) {
    corners.col[i] = points[triangle.vertex[i]].col;
    corners.row[i] = points[triangle.vertex[i]].row;
  }
  return corners;
}

}  // namespace

void CheckTriangles(const std::vector<SupportPoint>& points, const std::vector<SupportTriangle>& triangles) {
  const int count = static_cast<int>(points.size());
  for (size_t i = 0; i < triangles.size(); ++i) {
    for (int vertex : triangles[i].vertex) {
      if (vertex < 0 || vertex >= count) {
        throw InvalidInputError(
            Concat("triangle ", i, " has vertex ", vertex, ": must be in [0, ", count - 1, "], the support points"));
      }
      CheckRange("column of a support point", points[vertex].col, -kMaxCoordinate, kMaxCoordinate);
      CheckRange("row of a support point", points[vertex].row, -kMaxCoordinate, kMaxCoordinate);
    }
  }
}

Image<int> RasterizeTriangles(int width, int height, const std::vector<SupportPoint>& points,
                              const std::vector<SupportTriangle>& triangles) {
  CheckRange("width of the raster", width, 0, kMaxCoordinate);
  CheckRange("height of the raster", height, 0, kMaxCoordinate);
  CheckTriangles(points, triangles);
  Image<int> ids(width, height, -1);
  if (ids.empty()) return ids;
  // Each task owns its rows and fills them in triangle order: the result is the same for any number of threads.
  tbb::parallel_for(0, (height + kBandRows - 1) / kBandRows, [&](int band) {
    const int band_begin = band * kBandRows, band_end = std::min(band_begin + kBandRows, height);
    for (size_t i = 0; i < triangles.size(); ++i) {
      const TriangleCorners corners = CornersOf(points, triangles[i]);
      const auto [low, high] = std::minmax({corners.row[0], corners.row[1], corners.row[2]});
      if (high < band_begin || low >= band_end) continue;
      const RasterTriangle triangle = MakeRasterTriangle(corners);
      for (int row = std::max(band_begin, low); row < std::min(band_end, high + 1); ++row) {
        const ColumnSpan span = SpanOfRow(triangle, row, width);
        for (int col = span.first; col <= span.last; ++col) ids(col, row) = static_cast<int>(i);
      }
    }
  });
  return ids;
}

}  // namespace acmp
