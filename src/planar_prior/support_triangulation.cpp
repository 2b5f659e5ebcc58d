#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <cstdint>
#include <tuple>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {
namespace {

/// Integers: exact without the filters of CGAL's kernels for floating point, which takes a third off the time.
using Kernel = CGAL::Simple_cartesian<int64_t>;
/// With differences of 15 bits the test of a circle stays below 2^63: two products of a doubled area (2^31) and a sum
/// of two products of differences (2^31).
constexpr int64_t kMaxDifference = (1 << 15) - 1;

using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<int, Kernel>;  // info: index of the support point
using Delaunay = CGAL::Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<VertexBase>>;

void CheckExtent(const char* name, const std::vector<SupportPoint>& points, int SupportPoint::*coordinate) {
  const auto [low, high] =
      std::minmax_element(points.begin(), points.end(),
                          [&](const SupportPoint& a, const SupportPoint& b) { return a.*coordinate < b.*coordinate; });
  if (low == points.end()) return;
  CheckRange(name, int64_t{(*high).*coordinate} - (*low).*coordinate, int64_t{0}, kMaxDifference);
}

/// An order in which the points are inserted fast: coarse grids before finer ones, so that no triangle is long when
/// many are to come, and within each row by row to and fro, so that each point is near the one before. Takes 0.7 of the
/// time of CGAL's own order, a space-filling curve.
std::vector<size_t> CoarseToFine(const std::vector<SupportPoint>& points, int spacing) {
  constexpr int kLevels = 6;
  struct Place {
    int level, row, along;
    size_t index;
    bool operator<(const Place& other) const {
      return std::tie(level, row, along, index) < std::tie(other.level, other.row, other.along, other.index);
    }
  };
  std::vector<Place> places;
  places.reserve(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const int col = points[i].col / spacing, row = points[i].row / spacing;
    int halvings = 0;
    while (halvings < kLevels && ((col | row) >> halvings) % 2 == 0) ++halvings;
    const bool is_backward = (row >> halvings) % 2 != 0;
    places.push_back({kLevels - halvings, row, is_backward ? -col : col, i});
  }
  std::sort(places.begin(), places.end());
  std::vector<size_t> order;
  order.reserve(points.size());
  for (const Place& place : places) order.push_back(place.index);
  return order;
}

}  // namespace

std::vector<SupportTriangle> TriangulateSupportPoints(const std::vector<SupportPoint>& points, int spacing) {
  CheckRange("spacing of the support points", int64_t{spacing}, int64_t{1}, kMaxDifference);
  CheckExtent("range of the support points' columns", points, &SupportPoint::col);
  CheckExtent("range of the support points' rows", points, &SupportPoint::row);
  Delaunay delaunay;
  Delaunay::Face_handle near;
  size_t inserted = 0;
  for (const size_t i : CoarseToFine(points, spacing)) {
    const Delaunay::Vertex_handle vertex = delaunay.insert(Kernel::Point_2(points[i].col, points[i].row), near);
    if (delaunay.number_of_vertices() != ++inserted) {
      throw InvalidInputError(Concat("support point at pixel (", points[i].col, ", ", points[i].row,
                                     ") is given more than once: pixels must be distinct"));
    }
    vertex->info() = static_cast<int>(i);
    near = vertex->face();
  }

  std::vector<SupportTriangle> triangles;
  triangles.reserve(delaunay.number_of_faces());
  for (auto face = delaunay.finite_faces_begin(); face != delaunay.finite_faces_end(); ++face) {
    triangles.push_back({{face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()}});
  }
  return triangles;
}

}  // namespace acmp
