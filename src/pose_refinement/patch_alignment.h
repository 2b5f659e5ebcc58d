#pragma once

#include <Eigen/Core>

#include "gray_pyramid.h"

namespace acmp {

/// Where the surroundings of a pixel are found in another image.
struct Alignment {
  bool found = false;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< in the other image, to a fraction of a pixel
  double ncc = -1;                                  ///< normalised cross-correlation there
};

/// How to align.
struct AlignmentOptions {
  int half_width = 6;     ///< px; the patch has 2 half_width + 1 px per side, at every level
  int start_level = 2;    ///< of the pyramids
  int iterations = 12;    ///< per level, at most
  double min_ncc = 0.85;  ///< less: not found
  double max_shift = 12;  ///< px from the start; more: not found
};

/// Finds the patch around `pixel` of `image` in `other`, starting at `start`, by inverse compositional Lucas-Kanade
/// alignment (Baker and Matthews 2004) of the two coordinates, insensitive to brightness and contrast, from coarse to
/// fine. The patch is warped first.
/// @param warp affine: what moves by d in `image` moves by warp * d in `other`
Alignment Align(const GrayPyramid& image, const Eigen::Vector2d& pixel, const Eigen::Matrix2d& warp,
                const GrayPyramid& other, const Eigen::Vector2d& start, const AlignmentOptions& options);

}  // namespace acmp
