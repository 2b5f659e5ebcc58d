#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

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

/// Unless there is a frame, and an estimate of this size is of its image halved `level` times.
void CheckUpsample(const FramePtr& frame, int level, int width, int height);

/// The problem as PatchMatch sees it, with the cameras of a level, without the sources' depth maps. Pixels are the
/// frames', at full size. Checked (Check).
PatchMatchProblem MakePatchMatchProblem(const EngineProblem& problem, int level);

/// The reference against its sources as the engine's fusion kernels read them, in the reference's frame. Sources
/// without an estimate take no part. Unless there are frames with a camera and a pose, at most kMaxFusionSources
/// sources, and maps of the cameras' size.
/// @param maps_of the reference, or a source with an estimate
/// @param stamps_of a frame: points of a whole scene are made, in the world. Null: they are not
/// @param current of the reference, then
FusionSetup SetUpFusion(const EngineView& reference, const std::vector<EngineView>& sources, const FusionLimits& limits,
                        const std::function<FusionMaps(const EngineView&)>& maps_of,
                        const std::function<ImageView<Stamp>(const Frame&)>& stamps_of = nullptr, Stamp current = 0);

}  // namespace acmp
