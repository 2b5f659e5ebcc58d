#pragma once

#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/completion/completion_options.h"
#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/patch_match/patch_match.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {

/// Grey pixels of a frame where the engine that loaded them reads them, with those of its halved images. Immutable.
class EngineImage {
 public:
  virtual ~EngineImage() = default;
};
using EngineImagePtr = std::shared_ptr<const EngineImage>;

/// What a pass leaves of a reference view where the engine that ran it reads it: plane, cost and depth of every pixel.
/// Immutable: a later pass makes a new one, so that others go on reading this (Jacobi). Only one that nobody else holds
/// is used up: moved into a pass, it gives the new one its memory.
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
};

struct EngineProblem {
  EngineView reference;
  std::vector<EngineView> sources;  ///< 1..32, best first
  DepthRange depth_range;
};

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

/// All of an estimate, as it has to be kept for a later pass.
struct EstimateState {
  PlaneMap planes;
  CostMap cost;
};

/// Which pixels of which frames have gone into points (see FuseDepthMaps), on the devices of the engines that use it.
class FusionStamps {
 public:
  virtual ~FusionStamps() = default;
};

/// The device's steps of Algorithm 1. Images and estimates stay where the steps run; what the host needs is asked for.
/// Same input, options and device: same bits. An engine is used by one thread at a time; images and estimates may be
/// shared among the engines that Share() made. Handles of another device are an InvalidInputError. Every method throws
/// InvalidInputError for bad input and ProcessingError when the device fails; after either the engine can be used
/// again.
class DepthEngine {
 public:
  virtual ~DepthEngine() = default;

  /// Another engine on the same device, for another thread: the two work at the same time and share handles.
  virtual std::unique_ptr<DepthEngine> Share() = 0;

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

  /// Steps 12-20 from an estimate at full size, which is used up if nobody else holds it.
  virtual EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                           EngineEstimatePtr start, const PriorMesh& prior) = 0;

  /// Steps 22-30, once, from an estimate at any level, used up as in RunPlanarPrior, on the images of that level. The
  /// sources' estimates, of the same level, are read as they are; `pass` (0, 1, ...) selects the random numbers, and
  /// later ones leave settled pixels alone (PatchMatchOptions).
  virtual EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                         EngineEstimatePtr start, int pass) = 0;

  /// ACMM's step between two scales (RestorePixel): pixels of a photometric estimate, which is used up as in
  /// RunPlanarPrior, take the upsampled planes of the next coarser level's estimate unless they match clearly better.
  virtual EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                           EngineEstimatePtr start, const EngineEstimatePtr& coarser) = 0;

  /// CompleteUnconfirmed of the reference's estimate (not null) against the sources'; those without one do not count.
  /// Pixels that get another surface's plane have a cost of kWorstCost or kUnverifiedCost then.
  virtual EngineEstimatePtr Complete(const EngineProblem& problem, const CompletionOptions& options) = 0;

  /// RefuteUnsupported of the reference's estimate `start`, which is used up as in RunPlanarPrior, with the images,
  /// against the sources' estimates; those without one do not count.
  virtual EngineEstimatePtr RefuteUnsupported(const EngineProblem& problem, EngineEstimatePtr start) = 0;

  /// FilterByConsistency of the reference's estimate (not null) against the sources', with the frames' colours.
  virtual ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                                const FusionOptions& options) = 0;

  /// Only the confidences of the same: on a device points would have to be fetched.
  virtual ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                          const FusionOptions& options) {
    return FilterByConsistency(reference, sources, options).confidence;
  }

  /// Stamps of no pixel yet, for this engine and all others of its kind: those on the CPU, or on any of the GPUs.
  virtual std::unique_ptr<FusionStamps> MakeFusionStamps() = 0;

  /// FuseDepthMaps, one view per call: the reference's points in the world. Views without an estimate take no part.
  /// The caller fuses views that have a frame in common (as reference or source) one after the other, by rank: anything
  /// else is a data race. Others do not touch the same stamps: they may be fused in any order, and by several engines
  /// at the same time. The points are those of fusing all views by rank. An error leaves the stamps of this view half
  /// set: the fusion cannot go on.
  /// @param rank the view's own place in the order of fusion, 0..kMaxFusionViews - 1
  /// @param stamps of MakeFusionStamps of an engine of this kind; of another it is an InvalidInputError
  virtual PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources,
                              const FusionOptions& options, int rank, FusionStamps* stamps) = 0;

  virtual EstimateMaps Download(const EngineEstimatePtr& estimate) = 0;
  /// Only the depths of the same: a sixth of what has to come from a device.
  virtual DepthMap DownloadDepth(const EngineEstimatePtr& estimate) { return Download(estimate).depth; }
  virtual EstimateState DownloadState(const EngineEstimatePtr& estimate) = 0;
  virtual EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) = 0;

  /// The estimate where this engine can use it: copied from another GPU, else as it is.
  virtual EngineEstimatePtr Import(const EngineEstimatePtr& estimate) { return estimate; }

  /// An estimate with these depths and normals, for the consistency check and fusion.
  virtual EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) = 0;

  /// Device time of the passes and filters since the last call, ms; 0 where it is not measured.
  virtual double TakeDeviceMs() = 0;

  /// Bytes of device memory that images and estimates of all sharing engines take at present; 0 on the host.
  virtual size_t DeviceBytes() const = 0;
  /// Bytes of device memory that are free for more; 0 on the host.
  virtual size_t FreeDeviceBytes() const = 0;

  /// "cpu (2 threads)", "NVIDIA H200 (cuda:0)".
  virtual std::string device_name() const = 0;
};

/// Whether the caller has the only handle of what `estimate` points to: nobody else reads it, now or later.
bool IsHeldByNobodyElse(const EngineEstimatePtr& estimate);

constexpr int kMaxLevels = 2;  ///< times an image can be halved

/// The camera of the image halved `level` times.
PinholeCamera CameraAtLevel(PinholeCamera camera, int level);

/// The level whose images of the reference have this size. Throws InvalidInputError where none has.
int LevelOf(const EngineProblem& problem, int width, int height);

/// Throws InvalidInputError unless frames and images are there, and 0 <= level <= kMaxLevels.
void CheckHandles(const EngineProblem& problem, int level);

/// The problem as PatchMatch sees it, at full size, without the sources' depth maps. Pixels are the frames'.
PatchMatchProblem MakePatchMatchProblem(const EngineProblem& problem);

}  // namespace acmp
