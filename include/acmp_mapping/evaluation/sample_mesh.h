#pragma once

#include "acmp_mapping/fusion/triangle_mesh.h"

namespace acmp {

/// Points all over a mesh, at most `spacing` apart: the middles of the equal triangles into which each triangle is cut.
/// Throws InvalidInputError unless spacing is positive and finite, and for more than 2^31 points.
PointCloud SampleMesh(const TriangleMesh& mesh, double spacing);

}  // namespace acmp
