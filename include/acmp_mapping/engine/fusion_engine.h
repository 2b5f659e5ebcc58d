#pragma once

#include <memory>
#include <vector>

#include "acmp_mapping/engine/matching_engine.h"
#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

/// Which pixels of which frames have gone into points (see FuseView), on the devices of the engines that use it.
class FusionStamps {
 public:
  virtual ~FusionStamps() = default;
};

/// What is made of finished estimates: confidence, points of one keyframe, points of a whole scene.
class FusionEngine {
 public:
  virtual ~FusionEngine() = default;

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

  /// Which pixels of a frame have gone into points, at its size: 1 or 0. For another process that goes on with the
  /// fusion. `stamps` as for FuseView.
  virtual Image<unsigned char> FusedPixels(const Frame& frame, FusionStamps* stamps) = 0;
  /// Before any view is fused: these pixels of a frame count as those of a view of rank 0, so that ranks go on from 1.
  /// Throws InvalidInputError for pixels of another size than the frame's.
  virtual void SetFusedPixels(const Frame& frame, const Image<unsigned char>& used, FusionStamps* stamps) = 0;
};

}  // namespace acmp
