#pragma once

#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// The passes of Algorithm 1 on the CPU: the kernel functions in a TBB loop, with bilinear sampling in float32. Same
/// input: same bits, whatever the number of threads. All throw InvalidInputError for a bad problem or bad options, and
/// for maps of another size than the reference's.

/// One pass: steps 3-8 (random initialisation and T_photo iterations with the cost of eq. 1), 12-20 (T_p-photo with
/// that of eq. 7; pixels without a prior plane are matched by eq. 1 alone) or 22-30, once (T_geo with that of eq. 13
/// against the sources' depth maps; a source without one counts with the truncated error everywhere).
/// @param start not read by a photometric pass
/// @param prior of a planar-prior pass
/// @param geometric_pass 0, 1, ... selects the random numbers of a geometric pass
EstimateState RunPass(const PatchMatchProblem& problem, const PatchMatchOptions& options, Pass kind,
                      EstimateState start = {}, const PriorMap& prior = {}, int geometric_pass = 0);

/// What ACMM does between two scales: every pixel of a photometric estimate takes the plane of the next coarser scale's
/// estimate, upsampled by the image (UpsampleJointly), unless its own matches clearly better (RestorePixel).
/// @param coarser of the reference's camera halved once
EstimateState RestoreDetails(const PatchMatchProblem& problem, const PatchMatchOptions& options, EstimateState start,
                             const ImageView<const PlaneHypothesis>& coarser);

/// DepthEvidence of the pixel in the middle of each cell of `cell_size` x `cell_size` px, 1 or more, the last ones cut
/// off at the image's border. Sources without a depth map do not count.
Image<float> MeasureEvidence(const PatchMatchProblem& problem, const PlaneMap& planes, int cell_size);

/// Depth z of every pixel's plane; 0 where there is none.
DepthMap ToDepthMap(const PlaneMap& planes, const PinholeCamera& camera);
NormalMap ToNormalMap(const PlaneMap& planes);

}  // namespace acmp
