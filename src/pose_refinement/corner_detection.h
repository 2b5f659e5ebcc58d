#pragma once

#include <Eigen/Core>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "gray_pyramid.h"

namespace acmp {

struct CornerOptions {
  int cell = 24;              ///< px: at most one corner in each cell of a grid
  int border = 10;            ///< px from the image's border
  double min_gradient = 1.5;  ///< grey values per px, root mean square along the weaker direction
};

/// So that an image has about so many cells.
CornerOptions CornersFor(const PinholeCamera& camera, int corners);

/// Corners (Shi and Tomasi 1994: the smaller eigenvalue of the gradients' covariance over 5 x 5 px has a local maximum
/// there), the strongest of each cell, cells row by row. Cells that hold one of `taken` are left out.
std::vector<Eigen::Vector2d> DetectCorners(const Image<uint8_t>& image, const std::vector<Eigen::Vector2d>& taken,
                                           const CornerOptions& options);

}  // namespace acmp
