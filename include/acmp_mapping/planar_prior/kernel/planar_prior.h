#pragma once

#include <cstdint>

#include "acmp_mapping/common/host_device.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// A credible correspondence: pixel and depth.
struct SupportPoint {
  int col = 0, row = 0;
  float depth = 0;  ///< z; 0: none
};

/// The best pixel of cell (cell_col, cell_row) with a cost below max_cost and a depth within [depth_min, depth_max],
/// the first in row-major order among equals; depth 0 where there is none. NaN costs and depths fail the comparisons.
ACMP_HOST_DEVICE inline SupportPoint FindSupportPointOfCell(const ImageView<const float>& depth,
                                                            const ImageView<const float>& cost, float depth_min,
                                                            float depth_max, float max_cost, int cell_size,
                                                            int cell_col, int cell_row) {
  SupportPoint best;
  float best_cost = max_cost;
  const int col_end = (cell_col + 1) * cell_size < depth.width ? (cell_col + 1) * cell_size : depth.width;
  const int row_end = (cell_row + 1) * cell_size < depth.height ? (cell_row + 1) * cell_size : depth.height;
  for (int row = cell_row * cell_size; row < row_end; ++row) {
    for (int col = cell_col * cell_size; col < col_end; ++col) {
      const float z = depth(col, row);
      if (!(cost(col, row) < best_cost) || !(z >= depth_min && z <= depth_max)) continue;
      best_cost = cost(col, row);
      best = {col, row, z};
    }
  }
  return best;
}

/// Corners of a triangle in pixels, either winding; coordinates within +-2^28, so that edge functions stay below 2^63.
struct TriangleCorners {
  int col[3], row[3];
};

ACMP_HOST_DEVICE inline int64_t FloorDivide(int64_t a, int64_t b) {  // b > 0
  const int64_t quotient = a / b;
  return quotient * b > a ? quotient - 1 : quotient;
}

ACMP_HOST_DEVICE inline int64_t CeilDivide(int64_t a, int64_t b) { return -FloorDivide(-a, b); }

/// The pixels with a * col + b * row + c >= 0.
struct HalfPlane {
  int64_t a, b, c;
};

/// The side of the line p -> q on which (q - p) x (pixel - p) is positive. A pixel on the line belongs to it if moving
/// the pixel by (e, e^2), e -> 0+, brings it inside: that is the top-left rule, and because all edges are decided by
/// the same displacement no pixel is shared or lost.
ACMP_HOST_DEVICE inline HalfPlane InnerSide(const TriangleCorners& corners, int p, int q) {
  HalfPlane side;
  side.a = static_cast<int64_t>(corners.row[p]) - corners.row[q];
  side.b = static_cast<int64_t>(corners.col[q]) - corners.col[p];
  side.c = -(side.a * corners.col[p] + side.b * corners.row[p]);
  const bool owns_border = side.a > 0 || (side.a == 0 && side.b > 0);
  if (!owns_border) side.c -= 1;  // E > 0 is E - 1 >= 0 for integers
  return side;
}

/// A triangle set up to be filled row by row.
struct RasterTriangle {
  HalfPlane sides[3];
  int row_min, row_max;
};

ACMP_HOST_DEVICE inline RasterTriangle MakeRasterTriangle(const TriangleCorners& corners) {
  const int64_t doubled_area =
      static_cast<int64_t>(corners.col[1] - corners.col[0]) * (corners.row[2] - corners.row[0]) -
      static_cast<int64_t>(corners.col[2] - corners.col[0]) * (corners.row[1] - corners.row[0]);
  // Of zero area: opposite sides exclude each other, no pixel is inside.
  const int second = doubled_area < 0 ? 2 : 1, third = 3 - second;
  RasterTriangle triangle = {
      {InnerSide(corners, 0, second), InnerSide(corners, second, third), InnerSide(corners, third, 0)},
      corners.row[0],
      corners.row[0]};
  for (int row : corners.row) {
    if (row < triangle.row_min) triangle.row_min = row;
    if (row > triangle.row_max) triangle.row_max = row;
  }
  return triangle;
}

/// Columns first .. last of a row that belong to the triangle, in 0 .. width - 1; none: last < first.
struct ColumnSpan {
  int first, last;
};

ACMP_HOST_DEVICE inline ColumnSpan SpanOfRow(const RasterTriangle& triangle, int row, int width) {
  int64_t first = 0, last = width - 1;
  for (const HalfPlane& side : triangle.sides) {
    const int64_t at_col_0 = side.b * row + side.c;
    if (side.a > 0) {
      const int64_t bound = CeilDivide(-at_col_0, side.a);
      if (bound > first) first = bound;
    } else if (side.a < 0) {
      const int64_t bound = FloorDivide(at_col_0, -side.a);
      if (bound < last) last = bound;
    } else if (at_col_0 < 0) {
      return {0, -1};
    }
  }
  if (last < first) return {0, -1};
  return {static_cast<int>(first), static_cast<int>(last)};
}

}  // namespace acmp
