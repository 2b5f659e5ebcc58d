#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/fill/fill_options.h"
#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
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

/// Whether the caller has the only handle of what `estimate` points to: nobody else reads it, now or later.
bool IsUnique(const EngineEstimatePtr& estimate);

constexpr int kMaxLevels = 2;  ///< times an image can be halved

/// The camera of the image halved `level` times.
PinholeCamera CameraAtLevel(PinholeCamera camera, int level);

/// The level whose images of the reference have this size. Throws InvalidInputError where none has.
int LevelOf(const EngineProblem& problem, int width, int height);

/// Maps of an estimate in host memory.
struct EstimateMaps {
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
};

/// Views of such maps.
struct EstimateMapViews {
  ImageView<const float> depth;
  ImageView<const Vec3f> normal;
  ImageView<const float> cost;
};

/// A pass over a reference view. Its size is that of the images halved `level` times.
struct EnginePass {
  Pass kind = Pass::kPhotometric;
  int level = 0;                      ///< of a photometric pass; geometric ones run at their start's, others at 0
  EngineEstimatePtr start = nullptr;  ///< that it goes on from, but for a photometric one
  int geometric_pass = 0;             ///< which one of them: selects the random numbers

  // Of a planar-prior pass; with neither of them no pixel has a prior.
  const PriorMesh* prior = nullptr;
  const PlanarPriorOptions* grid_prior = nullptr;  ///< MakeGridMesh of the start
};

/// Which pixels of which frames have gone into points (see FuseView), on the devices of the engines that use it.
class FusionStamps {
 public:
  virtual ~FusionStamps() = default;
};

/// All that a device does. Same input, options and device: same bits. Images and estimates stay where the steps run. An
/// engine is used by one thread at a time; images and estimates may be shared among the engines that Share() made.
/// Handles of another device are an InvalidInputError. Every method throws InvalidInputError for bad input and
/// ProcessingError when the device fails; after either the engine can be used again.
class DepthEngine {
 public:
  virtual ~DepthEngine() = default;

  /// Another engine on the same device, for another thread: the two work at the same time and share handles.
  virtual std::unique_ptr<DepthEngine> Share() = 0;

  /// Bytes of device memory that images and estimates of all sharing engines take at present; 0 on the host.
  virtual size_t DeviceBytes() const = 0;
  /// Bytes of device memory that are free for more; 0 on the host.
  virtual size_t FreeDeviceBytes() const = 0;

  /// "cpu (2 threads)", "NVIDIA H200 (cuda:0)".
  virtual std::string device_name() const = 0;

  // The steps of Algorithm 1 that touch pixels, and the filling of what they leave unverified.

  /// @param levels how many times the image is halved, 0..2: the levels that passes can then ask for
  virtual EngineImagePtr Load(const FramePtr& frame, int levels) = 0;

  /// Steps 3-8 on the images halved `level` times. The estimate has the size of those.
  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) {
    return RunPass(problem, options, {Pass::kPhotometric, level});
  }

  /// Every pixel takes plane and cost of the pixel that covers it in an estimate of `level`; size of the full image.
  virtual EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) = 0;

  /// Support points (step 10) in the pixels of the estimate.
  virtual std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                                      const PlanarPriorOptions& options) = 0;

  /// Steps 12-20 from an estimate at full size, whose memory they take if nobody else holds it.
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) {
    return RunPass(problem, options, {Pass::kPlanarPrior, 0, std::move(start), 0, &prior});
  }

  /// Steps 10-20, taken as in RunPlanarPrior, with our prior of the estimate's support points (MakeGridMesh).
  EngineEstimatePtr RunGridPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, const PlanarPriorOptions& prior) {
    return RunPass(problem, options, {Pass::kPlanarPrior, 0, std::move(start), 0, nullptr, &prior});
  }

  /// Steps 22-30, once, from an estimate at any level, taken as in RunPlanarPrior, on the images of that level. The
  /// sources' estimates, of the same level, are read as they are; `pass` (0, 1, ...) selects the random numbers.
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) {
    return RunPass(problem, options, {Pass::kGeometric, 0, std::move(start), pass});
  }

  /// Any of these.
  virtual EngineEstimatePtr RunPass(const EngineProblem& problem, const PatchMatchOptions& options,
                                    EnginePass pass) = 0;

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

  // What is made of finished estimates: confidence, points of one keyframe, points of a whole scene.

  /// FilterByConsistency (fusion/depth_fusion.h) of the reference's estimate (not null) against the sources', with the
  /// frames' colours; at most kMaxFusionSources of them.
  virtual ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                                const FusionOptions& options) = 0;

  /// Only the confidences of the same: on a device points would have to be fetched.
  virtual ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                          const FusionOptions& options) {
    return FilterByConsistency(reference, sources, options).confidence;
  }

  /// Stamps of no pixel yet, for this engine and all others of its kind: those on the CPU, or on any of the GPUs.
  virtual std::unique_ptr<FusionStamps> MakeFusionStamps() = 0;

  /// Fuses one view of a scene: the reference's points in the world, in row-major order. A pixel that went into a point
  /// of an earlier view is not used again, neither averaged nor counted as agreeing; the pixels of one view are decided
  /// together, so one source pixel may go into several of its points. Views without an estimate take no part.
  /// The caller fuses views that have a frame in common (as reference or source) one after the other, by rank: anything
  /// else is a data race. Others do not touch the same stamps: they may be fused in any order, and by several engines
  /// at the same time. The points are those of fusing all views by rank. An error leaves the stamps of this view half
  /// set: the fusion cannot go on.
  /// @param rank the view's own place in the order of fusion, 0..kMaxFusionViews - 1
  /// @param stamps of MakeFusionStamps of an engine of this kind; of another it is an InvalidInputError
  virtual PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources,
                              const FusionOptions& options, int rank, FusionStamps* stamps) = 0;

  // The way of estimates to the host, back, and from one device to another.

  virtual EstimateMaps Download(const EngineEstimatePtr& estimate) = 0;
  /// Only the depths of the same: a sixth of what has to come from a device.
  virtual DepthMap DownloadDepth(const EngineEstimatePtr& estimate) { return Download(estimate).depth; }
  virtual EstimateState DownloadState(const EngineEstimatePtr& estimate) = 0;
  virtual EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) = 0;

  /// The estimate where this engine can use it: copied from another GPU, else as it is.
  virtual EngineEstimatePtr Import(const EngineEstimatePtr& estimate) { return estimate; }

  /// An estimate with these depths and normals, for the consistency check and fusion.
  virtual EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) = 0;
};

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

/// Unless the maps have the camera's size.
void CheckUpload(const EstimateState& state, const PinholeCamera& camera);

/// The planes of maps; none where no depth is known. Unless the maps have the camera's size.
PlaneMap MakePlanes(const EstimateMapViews& maps, const PinholeCamera& camera);

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
