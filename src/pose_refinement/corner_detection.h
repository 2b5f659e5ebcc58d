#pragma once

#include <Eigen/Core>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "view.h"

namespace acmp {

struct CornerOptions {
  int cell = 24;              ///< px: at most one corner in each cell of a grid
  int border = 10;            ///< px from the image's border and from what its mask ignores
  double min_gradient = 1.5;  ///< grey values per px, root mean square along the weaker direction
};

/// So that an image has about so many cells.
CornerOptions CornersFor(const PinholeCamera& camera, int corners);

/// At each pixel the smaller eigenvalue of the gradients' covariance over 5 x 5 px (Shi and Tomasi 1994), as
/// cv::cornerMinEigenVal scales it.
Image<float> CornerResponse(const Image<uint8_t>& image);

/// Local maxima of the response, the strongest of each cell, cells row by row, none near what the view's mask ignores.
/// Cells that hold one of `taken` are left out.
std::vector<Eigen::Vector2d> PickCorners(const View& view, const Image<float>& response,
                                         const std::vector<Eigen::Vector2d>& taken, const CornerOptions& options);

}  // namespace acmp
