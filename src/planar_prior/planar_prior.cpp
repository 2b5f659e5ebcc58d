#include "acmp_mapping/planar_prior/planar_prior.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <cmath>
#include <utility>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "check_triangles.h"

namespace acmp {
namespace {

Eigen::Vector3d BackProject(const PinholeCamera& camera, const SupportPoint& point) {
  return camera.Unproject({point.col, point.row}, point.depth);
}

/// Plane through the triangle's vertices in 3D, facing the camera; all zero when it is degenerate or grazing.
PlaneHypothesis PlaneOfTriangle(const PinholeCamera& camera, const std::vector<SupportPoint>& points,
                                const SupportTriangle& triangle, double min_cos) {
  const Eigen::Vector3d p = BackProject(camera, points[triangle.vertex[0]]);
  const Eigen::Vector3d q = BackProject(camera, points[triangle.vertex[1]]);
  const Eigen::Vector3d r = BackProject(camera, points[triangle.vertex[2]]);
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

}  // namespace

PriorMesh MakePriorMesh(const PinholeCamera& camera, std::vector<SupportPoint> points,
                        const PlanarPriorOptions& options) {
  Validate(options);
  std::vector<SupportTriangle> triangles = TriangulateSupportPoints(points, options.cell_size_px);
  return MakePriorMesh(camera, std::move(points), std::move(triangles), options);
}

PriorMesh MakePriorMesh(const PinholeCamera& camera, std::vector<SupportPoint> points,
                        std::vector<SupportTriangle> triangles, const PlanarPriorOptions& options) {
  Validate(options);
  CheckCamera("camera of the planar prior", camera);
  CheckDepths(points);
  CheckTriangles(points, triangles);
  const double min_cos = std::cos(options.max_grazing_angle_deg * kRadPerDeg<double>);
  PriorMesh mesh;
  mesh.planes.resize(triangles.size());
  tbb::parallel_for(size_t{0}, triangles.size(),
                    [&](size_t i) { mesh.planes[i] = PlaneOfTriangle(camera, points, triangles[i], min_cos); });
  mesh.points = std::move(points);
  mesh.triangles = std::move(triangles);
  return mesh;
}

PlaneMap RasterizePrior(const PinholeCamera& camera, const PriorMesh& mesh, const DepthRange& range) {
  CheckDepthRange("depth range of the planar prior", range);
  CheckRange("number of planes of the prior", mesh.planes.size(), mesh.triangles.size(), mesh.triangles.size());
  const Image<int> ids = RasterizeTriangles(camera.width, camera.height, mesh.points, mesh.triangles);
  const RayGrid rays = MakeRayGrid(camera);
  PlaneMap planes(camera.width, camera.height);
  tbb::parallel_for(0, camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) {
      if (ids(col, row) < 0) continue;
      const PlaneHypothesis& plane = mesh.planes[ids(col, row)];
      // The same float arithmetic as the matching passes: what passes here is in range there. NaN (zero plane) fails.
      const float depth = PlaneDepth(plane, rays.Ray(static_cast<float>(col), static_cast<float>(row)));
      if (depth >= range.min && depth <= range.max) planes(col, row) = plane;
    }
  });
  return planes;
}

}  // namespace acmp
