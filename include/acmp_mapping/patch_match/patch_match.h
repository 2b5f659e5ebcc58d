#pragma once

#include <memory>
#include <string>

#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// Device time of the last pass in milliseconds, where the backend measures it (0 otherwise).
struct PatchMatchTiming {
  double upload_ms = 0;
  double kernels_ms = 0;
  double download_ms = 0;
};

/// The three passes of Algorithm 1 on one device. Same problem, options and device: same bits. One object is used by
/// one thread at a time; its buffers grow to the largest problem seen and are reused. Every method throws
/// InvalidInputError for a bad problem and ProcessingError when the device fails; after either the object can be used
/// again.
class PatchMatch {
 public:
  virtual ~PatchMatch() = default;

  /// Steps 3-8: random initialisation and T_photo iterations with the cost of eq. 1.
  virtual PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions& options) = 0;

  /// Steps 12-20: T_p-photo iterations with the cost of eq. 7. `prior` has the reference's size; pixels without a prior
  /// plane are matched by eq. 1 alone.
  virtual PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                          const PatchMatchResult& start, ImageView<const PlaneHypothesis> prior) = 0;

  /// Steps 22-30, once: T_geo iterations with the cost of eq. 13 against the sources' depth maps. A source without a
  /// depth map counts with the truncated error everywhere. `pass` (0, 1, ...) selects the random numbers.
  virtual PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                        const PatchMatchResult& start, int pass) = 0;

  /// DepthEvidence of the pixel in the middle of each cell of `cell_size` x `cell_size` px, the last ones cut off at
  /// the image's border. `planes` has the reference's size. Sources without a depth map do not count.
  virtual Image<float> MeasureEvidence(const PatchMatchProblem& problem, const PlaneMap& planes, int cell_size) = 0;

  virtual PatchMatchTiming last_timing() const = 0;

  /// "cpu (2 threads)", "NVIDIA H200 (cuda:0)".
  virtual std::string device_name() const = 0;
};

/// The reference implementation: the shared kernel functions in a TBB loop, with bilinear sampling in float32.
std::unique_ptr<PatchMatch> MakePatchMatchCpu();

/// Depth z of every pixel's plane; 0 where there is none.
DepthMap ToDepthMap(const PlaneMap& planes, const PinholeCamera& camera);
NormalMap ToNormalMap(const PlaneMap& planes);

}  // namespace acmp
