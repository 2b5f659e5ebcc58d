#pragma once

#include <cstddef>
#include <string>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

/// What becomes of the pixels of a reference view in FilterByConsistency: each is counted once. One that becomes no
/// point counts for what most of its sources say, the check that they fail first; of equals for the earlier one.
struct PointLosses {
  size_t pixels = 0;         ///< looked at
  size_t without_depth = 0;  ///< depth or normal unknown
  size_t unconfirmed = 0;    ///< unconfirmed or unsupported pixels, which are no points whatever their confidence
  size_t outside = 0;        ///< behind or outside the sources' images
  size_t source_depth = 0;   ///< the sources know no depth there
  size_t reprojection = 0;   ///< sent back too far away, px
  size_t relative_depth = 0;
  size_t angle = 0;   ///< between normals
  size_t uneven = 0;  ///< they agree, and the surface around does not
  size_t points = 0;
};

/// Looks at every `step`-th pixel of every `step`-th row. Without a source all known pixels are `outside`. Throws
/// InvalidInputError unless step is 1..1000.
/// @param setup of maps in host memory
PointLosses CountPointLosses(const FusionSetup& setup, int step);

/// "reprojection 71 %, depth 20 %, confidence 9 %", most first, without what is below 1 %; then what may be the cause
/// of the first, as a clause for users of the ROS node. `options` are those that it was counted with.
std::string Describe(const PointLosses& losses, const FusionOptions& options);

}  // namespace acmp
