#pragma once

#include <vector>

#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {

/// Throws InvalidInputError for vertices that are no support points, or lie more than 2^28 px away.
void CheckTriangles(const std::vector<SupportPoint>& points, const std::vector<SupportTriangle>& triangles);

}  // namespace acmp
