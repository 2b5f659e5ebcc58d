#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <cstdint>
#include <set>
#include <utility>
#include <vector>

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

void CheckDistinct(const std::vector<SupportPoint>& points) {
  std::set<std::pair<int, int>> pixels;
  for (const SupportPoint& point : points) {
    if (pixels.emplace(point.col, point.row).second) continue;
    throw InvalidInputError(Concat("support point at pixel (", point.col, ", ", point.row,
                                   ") is given more than once: pixels must be distinct"));
  }
}

}  // namespace

std::vector<SupportTriangle> TriangulateSupportPoints(const std::vector<SupportPoint>& points) {
  CheckExtent("range of the support points' columns", points, &SupportPoint::col);
  CheckExtent("range of the support points' rows", points, &SupportPoint::row);
  CheckDistinct(points);
  std::vector<std::pair<Kernel::Point_2, int>> numbered;
  for (const SupportPoint& point : points) {
    numbered.emplace_back(Kernel::Point_2(point.col, point.row), static_cast<int>(numbered.size()));
  }
  Delaunay delaunay;
  delaunay.insert(numbered.begin(), numbered.end());

  std::vector<SupportTriangle> triangles;
  triangles.reserve(delaunay.number_of_faces());
  for (auto face = delaunay.finite_faces_begin(); face != delaunay.finite_faces_end(); ++face) {
    triangles.push_back({{face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()}});
  }
  return triangles;
}

}  // namespace acmp
