#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdint>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {
namespace {

/// Keeps every edge function below 2^63: differences < 2^29, products with pixels < 2^60, three of them summed.
constexpr int kMaxCoordinate = 1 << 28;
/// Rows one task fills; a triangle is set up once per band it meets.
constexpr int kBandRows = 32;

int64_t FloorDivide(int64_t a, int64_t b) {  // b > 0
  const int64_t quotient = a / b;
  return quotient * b > a ? quotient - 1 : quotient;
}

int64_t CeilDivide(int64_t a, int64_t b) { return -FloorDivide(-a, b); }

/// The pixels with a * col + b * row + c >= 0.
struct HalfPlane {
  int64_t a, b, c;
};

/// The side of the line p -> q on which (q - p) x (pixel - p) is positive. A pixel on the line belongs to it if moving
/// the pixel by (e, e^2), e -> 0+, brings it inside: that is the top-left rule, and because all edges are decided by
/// the same displacement no pixel is shared or lost.
HalfPlane InnerSide(const SupportPoint& p, const SupportPoint& q) {
  HalfPlane side;
  side.a = static_cast<int64_t>(p.row) - q.row;
  side.b = static_cast<int64_t>(q.col) - p.col;
  side.c = -(side.a * p.col + side.b * p.row);
  const bool owns_border = side.a > 0 || (side.a == 0 && side.b > 0);
  if (!owns_border) side.c -= 1;  // E > 0 is E - 1 >= 0 for integers
  return side;
}

struct RasterTriangle {
  HalfPlane sides[3];
  int row_min, row_max;
};

RasterTriangle SetUp(const std::vector<SupportPoint>& points, const SupportTriangle& triangle) {
  const SupportPoint& p = points[triangle.vertex[0]];
  const SupportPoint* q = &points[triangle.vertex[1]];
  const SupportPoint* r = &points[triangle.vertex[2]];
  const int64_t doubled_area =
      static_cast<int64_t>(q->col - p.col) * (r->row - p.row) - static_cast<int64_t>(r->col - p.col) * (q->row - p.row);
  if (doubled_area < 0) std::swap(q, r);  // of zero area: opposite sides exclude each other, no pixel is inside
  return {{InnerSide(p, *q), InnerSide(*q, *r), InnerSide(*r, p)},
          std::min({p.row, q->row, r->row}),
          std::max({p.row, q->row, r->row})};
}

void FillRow(const RasterTriangle& triangle, int row, int id, ImageView<int> ids) {
  int64_t first = 0, last = ids.width - 1;
  for (const HalfPlane& side : triangle.sides) {
    const int64_t at_col_0 = side.b * row + side.c;
    if (side.a > 0) {
      first = std::max(first, CeilDivide(-at_col_0, side.a));
    } else if (side.a < 0) {
      last = std::min(last, FloorDivide(at_col_0, -side.a));
    } else if (at_col_0 < 0) {
      return;
    }
  }
  for (int64_t col = first; col <= last; ++col) ids(static_cast<int>(col), row) = id;
}

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
      const RasterTriangle triangle = SetUp(points, triangles[id]);
      const int row_end = std::min(band_end, triangle.row_max + 1);
      for (int row = std::max(band_begin, triangle.row_min); row < row_end; ++row) {
        FillRow(triangle, row, id, ids.View());
      }
    }
  });
  return ids;
}

}  // namespace acmp
