#pragma once

#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/planar_prior/kernel/planar_prior.h"

namespace acmp {

struct PlanarPriorOptions {
  int cell_size_px = 5;              ///< one support point per cell at most, 1..64
  float max_support_cost = 0.1f;     ///< epsilon of the paper: costs below are credible correspondences
  float max_grazing_angle_deg = 85;  ///< between a plane's normal and the ray to its triangle's centroid, (0, 90)
};

/// Per cell the pixel of least cost among those with a cost below max_support_cost and a depth in `range` ("sparse
/// credible correspondences"); the first in row-major order among equals. Row-major order of cells.
std::vector<SupportPoint> FindSupportPoints(ImageView<const float> depth, ImageView<const float> cost,
                                            const DepthRange& range, const PlanarPriorOptions& options);

/// Vertex indices into the support points, counter-clockwise with y up (clockwise on the screen) or the other way
/// round: the same for all triangles.
struct SupportTriangle {
  int vertex[3];
};

/// Delaunay triangulation of the support points' pixels (CGAL, exact predicates). Fewer than three points or all on a
/// line: empty. Duplicate pixels and columns or rows more than 32767 apart are an InvalidInputError. The set of
/// triangles does not depend on the points' order: CGAL decides between cocircular points by their coordinates.
std::vector<SupportTriangle> TriangulateSupportPoints(const std::vector<SupportPoint>& points);

/// Triangles of support points, and the plane of each.
struct PriorMesh {
  std::vector<TriangleCorners> triangles;
  /// Per triangle, in the camera's frame: through the three back-projected vertices, facing the camera. Zero for
  /// degenerate and grazing triangles.
  std::vector<PlaneHypothesis> planes;
};

/// Triangulates support points of the image of `camera`.
PriorMesh MakePriorMesh(const PinholeCamera& camera, const std::vector<SupportPoint>& points,
                        const PlanarPriorOptions& options);

/// Number of each pixel's triangle, from 1 on. Zero outside the triangulation, where the triangle has no plane, and
/// where the plane leaves the depth range at that pixel. Exact integer rasterisation with a top-left rule: each pixel
/// belongs to at most one triangle, and to exactly one if its centre lies in the half-open union of them (left and top
/// borders belong to it, right and bottom ones do not). Either winding; vertices may lie outside the image. Throws
/// InvalidInputError unless each triangle has a plane or the zero plane.
Image<uint32_t> RasterizePrior(const PinholeCamera& camera, const PriorMesh& mesh, const DepthRange& range);

/// Our triangles: those that the grid of the support points' cells makes (SupportGrid). Where they overlap, the last
/// one is a pixel's.
/// @param depth,cost of the camera's size
PriorMesh MakeGridMesh(const PinholeCamera& camera, ImageView<const float> depth, ImageView<const float> cost,
                       const DepthRange& range, const PlanarPriorOptions& options);

/// Cosine of max_grazing_angle_deg.
double MinPriorCosine(const PlanarPriorOptions& options);

}  // namespace acmp
