#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<int, Kernel>;  // info: index of the support point
using Delaunay = CGAL::Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<VertexBase>>;

[[noreturn]] void ThrowDuplicate(const std::vector<SupportPoint>& points) {
  std::vector<std::pair<int, int>> pixels;
  pixels.reserve(points.size());
  for (const SupportPoint& point : points) pixels.emplace_back(point.row, point.col);
  std::sort(pixels.begin(), pixels.end());
  const auto duplicate = std::adjacent_find(pixels.begin(), pixels.end());
  throw InvalidInputError(Concat("support point at pixel (", duplicate->second, ", ", duplicate->first,
                                 ") is given more than once: pixels must be distinct"));
}

}  // namespace

std::vector<SupportTriangle> TriangulateSupportPoints(const std::vector<SupportPoint>& points) {
  std::vector<std::pair<Kernel::Point_2, int>> vertices;
  vertices.reserve(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    vertices.emplace_back(Kernel::Point_2(points[i].col, points[i].row), static_cast<int>(i));
  }
  Delaunay delaunay;
  delaunay.insert(vertices.begin(), vertices.end());  // the range version sorts along a space-filling curve
  if (delaunay.number_of_vertices() != points.size()) ThrowDuplicate(points);

  std::vector<SupportTriangle> triangles;
  triangles.reserve(delaunay.number_of_faces());
  for (auto face = delaunay.finite_faces_begin(); face != delaunay.finite_faces_end(); ++face) {
    triangles.push_back({{face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()}});
  }
  return triangles;
}

}  // namespace acmp
