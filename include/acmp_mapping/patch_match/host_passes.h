#pragma once

#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// The passes of Algorithm 1 on the CPU: the kernel functions in a TBB loop, with bilinear sampling in float32. Same
/// input: same bits, whatever the number of threads. All throw InvalidInputError for a bad problem or bad options, and
/// for maps of another size than the reference's.

/// Steps 3-8: random initialisation and T_photo iterations with the cost of eq. 1.
EstimateState RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions& options);

/// Steps 12-20: T_p-photo iterations with the cost of eq. 7. Pixels without a prior plane are matched by eq. 1 alone.
EstimateState RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options, EstimateState start,
                             const ImageView<const PlaneHypothesis>& prior);

/// Steps 22-30, once: T_geo iterations with the cost of eq. 13 against the sources' depth maps. A source without a
/// depth map counts with the truncated error everywhere. `pass` (0, 1, ...) selects the random numbers.
EstimateState RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options, EstimateState start,
                           int pass);

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
