#include "acmp_mapping/evaluation/cloud_metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// Into how many parts each edge of a triangle is cut.
double PartsOf(const TriangleMesh& mesh, const std::array<uint32_t, 3>& triangle, double spacing) {
  double longest = 0;
  for (int i = 0; i < 3; ++i) {
    const Vec3f edge = mesh.vertices[triangle[i]].position - mesh.vertices[triangle[(i + 1) % 3]].position;
    longest = std::max<double>(longest, Norm(edge));
  }
  return std::max(1.0, std::ceil(longest / spacing));
}

}  // namespace

PointCloud SampleMesh(const TriangleMesh& mesh, double spacing) {
  if (!(spacing > 0 && std::isfinite(spacing))) {
    throw InvalidInputError(Concat("spacing = ", spacing, ": must be > 0 and finite"));
  }
  double count = 0;
  for (const auto& triangle : mesh.triangles) count += std::pow(PartsOf(mesh, triangle, spacing), 2);
  if (!(count < std::numeric_limits<int32_t>::max())) {
    throw InvalidInputError(Concat("the mesh has ", count, " points ", spacing, " apart: must be below 2^31"));
  }
  PointCloud points;
  points.reserve(static_cast<size_t>(count));
  for (const auto& triangle : mesh.triangles) {
    const SurfacePoint& corner = mesh.vertices[triangle[0]];
    const Vec3f u = mesh.vertices[triangle[1]].position - corner.position;
    const Vec3f v = mesh.vertices[triangle[2]].position - corner.position;
    const int parts = static_cast<int>(PartsOf(mesh, triangle, spacing));
    const auto add = [&](double a, double b) {
      SurfacePoint point = corner;
      point.position = corner.position + static_cast<float>(a / parts) * u + static_cast<float>(b / parts) * v;
      points.push_back(point);
    };
    for (int i = 0; i < parts; ++i) {
      for (int j = 0; i + j < parts; ++j) {
        add(i + 1.0 / 3, j + 1.0 / 3);
        if (i + j + 1 < parts) add(i + 2.0 / 3, j + 2.0 / 3);
      }
    }
  }
  return points;
}

}  // namespace acmp
