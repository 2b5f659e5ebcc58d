#pragma once

#include <string>

#include "acmp_mapping/fill/fill_options.h"
#include "acmp_mapping/geometry/plane_hypothesis.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

/// External depth (of a network, another sensor) in the scale of the images, where they do not contradict it.
struct FittedPriorDepth {
  DepthMap depth;         ///< z; 0: none, or not to be trusted there. Empty: nowhere
  std::string rejection;  ///< why it is used nowhere; else empty
};

/// Fits 1 / z = (shift + scale / prior) * (1 + drift) to known depths, robustly: first shift and scale, then a drift
/// that is linear over the image, then what the known depths around still differ by on average, since the scale of a
/// network's map wavers. Only the drift reaches to where nothing is known. Not used where most known depths around
/// disagree, and used nowhere unless shift and scale explain half of those that no plane explains, so that constant
/// maps, ramps and noise are refused. Of metric depth nothing is fitted; the same refuses it.
/// @param prior of the image, up to scale and shift of 1 / z; 0: unknown
/// @param known z of the pixels whose depth is credible, of the same size; 0: the others
FittedPriorDepth FitPriorDepth(ImageView<const float> prior, ImageView<const float> known, const DepthRange& range,
                               const PriorDepthOptions& options);

/// The plane of a pixel of a depth map, through its own depth and along what of its surroundings is of the same
/// surface; zero where it has no depth.
PlaneHypothesis PlaneOfPixel(ImageView<const float> depth, const RayGrid& rays, int col, int row);

/// After FillUnverified: a pixel that no view confirms (kWorstCost) takes the plane of the frame's prior depth, fitted
/// to what views confirm and to landmarks, in place of one extended from its surroundings. It remains
/// unconfirmed: passes choose by the images. Without prior depth nothing changes.
/// @param in_scale_of_frame whether planes have the scale of the frame's pose and landmarks, as without refined poses;
///   else landmarks tell nothing, and metric depth is fitted as other depth is
/// @param cost of the frame's size, as planes
/// @return why the prior depth is used nowhere; else empty
std::string UsePriorDepth(const Frame& frame, bool in_scale_of_frame, const DepthRange& range,
                          PriorDepthOptions options, ImageView<const float> cost, ImageView<PlaneHypothesis> planes);

}  // namespace acmp
