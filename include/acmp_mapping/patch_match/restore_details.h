#pragma once

#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// What ACMM does between two scales, on the CPU: every pixel of a photometric estimate takes the plane of the next
/// coarser scale's estimate, upsampled by the image (UpsampleJointly), unless its own matches clearly better
/// (RestorePixel).
/// @param coarser of the reference's camera halved once
/// @param planes,cost of the reference, from a photometric pass; changed
/// Throws InvalidInputError for a bad problem and for maps of other sizes.
void RestoreDetails(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                    const ImageView<const PlaneHypothesis>& coarser, const ImageView<PlaneHypothesis>& planes,
                    const ImageView<float>& cost);

}  // namespace acmp
