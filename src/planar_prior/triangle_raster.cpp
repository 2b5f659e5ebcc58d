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
/// Rows one task fills; a triangle is set up once per band it meets.
constexpr int kBandRows = 32;

TriangleCorners CornersOf(const std::vector<SupportPoint>& points, const SupportTriangle& triangle) {
  TriangleCorners corners;
  for (int i = 0; i < 3; ++i) {
    corners.col[i] = points[triangle.vertex[i]].col;
    corners.row[i] = points[triangle.vertex[i]].row;
  }
  return corners;
}

/// Triangles by band of rows, in the order of their indices: `ids` from first[band] to first[band + 1].
struct Bands {
  std::vector<size_t> first;
  std::vector<int> ids;
};

Bands SortIntoBands(int height, const std::vector<SupportPoint>& points,
                    const std::vector<SupportTriangle>& triangles) {
  const int band_count = (height + kBandRows - 1) / kBandRows;
  const auto for_each_band = [&](const SupportTriangle& triangle, auto&& visit) {
    const auto [low, high] =
        std::minmax({points[triangle.vertex[0]].row, points[triangle.vertex[1]].row, points[triangle.vertex[2]].row});
    if (high < 0 || low >= height) return;
    const int last_band = std::min(high, height - 1) / kBandRows;
    for (int band = std::max(low, 0) / kBandRows; band <= last_band; ++band) visit(band);
  };
  Bands bands;
  bands.first.assign(band_count + 1, 0);
  for (const SupportTriangle& triangle : triangles) {
    for_each_band(triangle, [&](int band) { ++bands.first[band + 1]; });
  }
  for (int band = 0; band < band_count; ++band) bands.first[band + 1] += bands.first[band];
  bands.ids.resize(bands.first.back());
  std::vector<size_t> next = bands.first;
  for (size_t i = 0; i < triangles.size(); ++i) {
    for_each_band(triangles[i], [&](int band) { bands.ids[next[band]++] = static_cast<int>(i); });
  }
  return bands;
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
  const Bands bands = SortIntoBands(height, points, triangles);
  // Each task owns its rows and fills them in triangle order: the result is the same for any number of threads.
  tbb::parallel_for(0, static_cast<int>(bands.first.size()) - 1, [&](int band) {
    const int band_begin = band * kBandRows;
    const int band_end = std::min(band_begin + kBandRows, height);
    for (size_t i = bands.first[band]; i < bands.first[band + 1]; ++i) {
      const int id = bands.ids[i];
      const RasterTriangle triangle = MakeRasterTriangle(CornersOf(points, triangles[id]));
      const int row_end = std::min(band_end, triangle.row_max + 1);
      for (int row = std::max(band_begin, triangle.row_min); row < row_end; ++row) {
        const ColumnSpan span = SpanOfRow(triangle, row, width);
        for (int col = span.first; col <= span.last; ++col) ids(col, row) = id;
      }
    }
  });
  return ids;
}

}  // namespace acmp
