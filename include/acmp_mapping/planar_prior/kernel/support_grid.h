#pragma once

#include "acmp_mapping/common/vector_math.h"
#include "acmp_mapping/geometry/plane_hypothesis.h"
#include "acmp_mapping/planar_prior/kernel/planar_prior.h"

namespace acmp {

// Our triangulation of support points. A Delaunay triangulation has to be searched for, point by point; that of a grid
// with one point per cell is known: 2 x 2 cells make two triangles. Cells without a point take the nearest one, as in a
// Voronoi diagram (by jump flooding: Rong and Tan, I3D 2006). Corners of triangles fall together there, and those that
// are left span what has no points.

/// Support points by cell, and the triangles between them.
struct SupportGrid {
  int cell_size;                    ///< px
  ImageView<SupportPoint> points;   ///< at first those of the cells (FindSupportPointOfCell)
  ImageView<SupportPoint> flooded;  ///< other memory of this size
  TriangleCorners* triangles;       ///< two per cell: those of its group
  PlaneHypothesis* planes;          ///< of these; zero where there is none, or a degenerate or grazing one
};

/// The first of the steps of jump flooding, in cells; the others are its halves down to 1. 0: there is a single cell.
inline int FirstFloodingStep(int cols, int rows) {
  int step = 0;
  for (int reach = 1; reach < cols || reach < rows; reach *= 2) step = reach;
  return step;
}

/// One step of a cell: its own point, else of those of itself and of the eight cells `step` away the nearest to its
/// middle, the first in row-major order of these cells among equals.
ACMP_HOST_DEVICE inline SupportPoint FloodCell(const ImageView<const SupportPoint>& points, int cell_size, int step,
                                               int col, int row) {
  SupportPoint nearest = points(col, row);
  if (nearest.depth > 0 && nearest.col / cell_size == col && nearest.row / cell_size == row) return nearest;
  int64_t least = 0;
  nearest = {};
  for (int i = 0; i < 9; ++i) {
    const int c = col + (i % 3 - 1) * step, r = row + (i / 3 - 1) * step;
    if (!points.Contains(c, r)) continue;
    const SupportPoint point = points(c, r);
    const int64_t dx = 2 * point.col - (2 * col + 1) * cell_size, dy = 2 * point.row - (2 * row + 1) * cell_size;
    const int64_t distance = dx * dx + dy * dy;
    if (!(point.depth > 0) || (nearest.depth > 0 && distance >= least)) continue;
    nearest = point;
    least = distance;
  }
  return nearest;
}

struct SupportTriangleCorners {
  SupportPoint p, q, r;

  /// Twice the area in the image; positive where the corners go round clockwise on the screen.
  ACMP_HOST_DEVICE int64_t DoubledArea() const {
    return static_cast<int64_t>(q.col - p.col) * (r.row - p.row) -
           static_cast<int64_t>(q.row - p.row) * (r.col - p.col);
  }
};

/// Plane through a triangle's corners in 3D, facing the camera; all zero where it is degenerate or grazing.
/// @param min_cosine of the angle between its normal and the ray to its centroid
ACMP_HOST_DEVICE inline PlaneHypothesis PlaneOfTriangle(const RayGrid& rays, const SupportTriangleCorners& triangle,
                                                        float min_cosine) {
  const SupportPoint& p = triangle.p;
  const Vec3f ray = rays.Ray(static_cast<float>(p.col), static_cast<float>(p.row));
  // From p's point to another one; coordinates themselves would be rounded to more than small triangles bear.
  const auto side = [&](const SupportPoint& q) {
    const Vec3f across = {static_cast<float>(q.col - p.col) * rays.inv_fx,
                          static_cast<float>(q.row - p.row) * rays.inv_fy, 0};
    return q.depth * across + (q.depth - p.depth) * ray;
  };
  const Vec3f to_q = side(triangle.q), to_r = side(triangle.r);
  const Vec3f centroid = p.depth * ray + (1.0f / 3) * (to_q + to_r);
  Vec3f normal = Cross(to_q, to_r);
  const float norm = Norm(normal);
  if (!(norm > 0) || !(norm < 1e30f)) return {};
  normal = ((Dot(normal, centroid) > 0 ? -1 : 1) / norm) * normal;
  const float distance = -Dot(normal, centroid);
  if (!(distance >= min_cosine * Norm(centroid))) return {};
  return {normal.x, normal.y, normal.z, distance};
}

/// Sets both triangles of the group of 2 x 2 cells whose first one is the given one, after flooding; the last column
/// and row begin none. Of the two diagonals it is the shorter one of those that leave no triangle the wrong way round.
/// Triangles that go the wrong way round all the same, as around points that were taken by others, are left out.
ACMP_HOST_DEVICE inline void SetTrianglesOfGroup(const SupportGrid& grid, const RayGrid& rays, float min_cosine,
                                                 int col, int row) {
  const ImageView<SupportPoint>& points = grid.points;
  const size_t first = 2 * (static_cast<size_t>(row) * points.width + col);
  for (size_t i = first; i < first + 2; ++i) {
    grid.triangles[i] = {};
    grid.planes[i] = {};
  }
  if (col + 1 >= points.width || row + 1 >= points.height) return;
  // Clockwise on the screen.
  const SupportPoint a = points(col, row), b = points(col + 1, row), c = points(col + 1, row + 1),
                     d = points(col, row + 1);
  if (!(a.depth > 0 && b.depth > 0 && c.depth > 0 && d.depth > 0)) return;  // there is no point at all
  const auto is_proper = [](const SupportTriangleCorners& one, const SupportTriangleCorners& other) {
    return one.DoubledArea() >= 0 && other.DoubledArea() >= 0;
  };
  const auto squared = [](const SupportPoint& p, const SupportPoint& q) {
    const int64_t dx = p.col - q.col, dy = p.row - q.row;
    return dx * dx + dy * dy;
  };
  const SupportTriangleCorners by_ac[2] = {{a, b, c}, {a, c, d}}, by_bd[2] = {{a, b, d}, {b, c, d}};
  const bool ac = is_proper(by_ac[0], by_ac[1]), bd = is_proper(by_bd[0], by_bd[1]);
  const bool takes_ac = ac != bd ? ac : squared(a, c) <= squared(b, d);
  for (int i = 0; i < 2; ++i) {
    const SupportTriangleCorners& corners = takes_ac ? by_ac[i] : by_bd[i];
    if (!(corners.DoubledArea() > 0)) continue;
    grid.triangles[first + i] = {{corners.p.col, corners.q.col, corners.r.col},
                                 {corners.p.row, corners.q.row, corners.r.row}};
    grid.planes[first + i] = PlaneOfTriangle(rays, corners, min_cosine);
  }
}

}  // namespace acmp
