#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/fill/fill_options.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {

/// Grey pixels of a frame and its mask where the engine that loaded them reads them, with those of its halved images.
/// Immutable.
class EngineImage {
 public:
  virtual ~EngineImage() = default;
};
using EngineImagePtr = std::shared_ptr<const EngineImage>;

/// What a pass leaves of a reference view where the engine that ran it reads it: plane, cost and depth of every pixel;
/// of pixels that the mask ignores no plane, depth 0 and kWorstCost.
/// Immutable: a later pass makes a new one, so that others go on reading this (Jacobi). Only one that nobody else
/// holds, moved into a pass, gives the new one its memory.
class EngineEstimate {
 public:
  virtual ~EngineEstimate() = default;
};
using EngineEstimatePtr = std::shared_ptr<const EngineEstimate>;

/// One image of a problem.
struct EngineView {
  FramePtr frame;
  EngineImagePtr image;
  EngineEstimatePtr estimate;  ///< of source views: for the geometric term and the consistency check; null: none yet
  std::optional<RigidTransform> refined_pose = std::nullopt;  ///< in place of the frame's cam_from_world

  const RigidTransform& cam_from_world() const { return refined_pose ? *refined_pose : frame->cam_from_world; }
};

struct EngineProblem {
  EngineView reference;
  std::vector<EngineView> sources;  ///< 1..32, best first
  DepthRange depth_range;
};

/// The steps of Algorithm 1 that touch pixels, and the filling of what they leave unverified. Images and estimates stay
/// where the steps run. See DepthEngine for threads, errors and determinism.
class MatchingEngine {
 public:
  virtual ~MatchingEngine() = default;

  /// @param levels how many times the image is halved, 0..2: the levels that passes can then ask for
  virtual EngineImagePtr Load(const FramePtr& frame, int levels) = 0;

  /// Steps 3-8 on the images halved `level` times. The estimate has the size of those.
  virtual EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                           int level) = 0;

  /// Every pixel takes plane and cost of the pixel that covers it in an estimate of `level`; size of the full image.
  virtual EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) = 0;

  /// Support points (step 10) in the pixels of the estimate.
  virtual std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                                      const PlanarPriorOptions& options) = 0;

  /// Steps 12-20 from an estimate at full size, whose memory they take if nobody else holds it.
  virtual EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                           EngineEstimatePtr start, const PriorMesh& prior) = 0;

  /// Steps 22-30, once, from an estimate at any level, taken as in RunPlanarPrior, on the images of that level. The
  /// sources' estimates, of the same level, are read as they are; `pass` (0, 1, ...) selects the random numbers.
  virtual EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                         EngineEstimatePtr start, int pass) = 0;

  /// ACMM's step between two scales (RestorePixel): pixels of a photometric estimate, which is taken as in
  /// RunPlanarPrior, take the upsampled planes of the next coarser level's estimate unless they match clearly better.
  virtual EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                           EngineEstimatePtr start, const EngineEstimatePtr& coarser) = 0;

  /// FillUnverified of the reference's estimate `start`, which is taken as in RunPlanarPrior, against the sources';
  /// those without one do not count. Pixels that get another surface's plane have a cost of kWorstCost or
  /// kUnverifiedCost then.
  virtual EngineEstimatePtr FillUnverified(const EngineProblem& problem, EngineEstimatePtr start,
                                           const FillOptions& options) = 0;

  /// RemoveUnsupported of the reference's estimate `start`, which is taken as in RunPlanarPrior, with the images,
  /// against the sources' estimates; those without one do not count.
  virtual EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) = 0;

  /// Device time of steps and filters since the last call, ms; 0 where it is not measured.
  virtual double PopDeviceTime() = 0;
};

/// Whether the caller has the only handle of what `estimate` points to: nobody else reads it, now or later.
bool IsUnique(const EngineEstimatePtr& estimate);

constexpr int kMaxLevels = 2;  ///< times an image can be halved

/// The camera of the image halved `level` times.
PinholeCamera CameraAtLevel(PinholeCamera camera, int level);

/// The level whose images of the reference have this size. Throws InvalidInputError where none has.
int LevelOf(const EngineProblem& problem, int width, int height);

// What all engines check and make of their input. Throw InvalidInputError.

/// Unless there is a frame, `levels` times halved an image is left, and the mask has the image's size.
void CheckLoad(const FramePtr& frame, int levels);

/// Of the frame's mask and of the masks halved up to `levels` times; empty maps without a mask.
std::vector<MaskDistanceMap> MakeMaskDistances(const Frame& frame, int levels);

/// Unless frames and images are there, and 0 <= level <= kMaxLevels.
void CheckHandles(const EngineProblem& problem, int level);

/// Unless there is a frame, and an estimate of this size is of its image halved `level` times.
void CheckUpsample(const FramePtr& frame, int level, int width, int height);

/// The problem as PatchMatch sees it, with the cameras of a level, without the sources' depth maps. Pixels are the
/// frames', at full size. Checked (Check).
PatchMatchProblem MakePatchMatchProblem(const EngineProblem& problem, int level);

}  // namespace acmp
