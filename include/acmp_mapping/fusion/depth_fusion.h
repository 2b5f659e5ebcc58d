#pragma once

#include <vector>

#include "acmp_mapping/fusion/fusion_options.h"
#include "acmp_mapping/fusion/kernel/fusion_context.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/posed_camera.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// What source views say of a reference view.
struct ConsistencyResult {
  ConfidenceMap confidence;     ///< probability that the depth is right (ConfidenceOf); 0 without depth
  PointCloud points_in_camera;  ///< of pixels that FusionOptions keeps, averaged with agreeing views; reference frame
};

constexpr int kMaxFusionViews = kUnfusedStamp;  ///< with a stamp each

FusionLimits MakeFusionLimits(const FusionOptions& options);

/// Throws InvalidInputError unless a stamp can hold the view's place in the order of fusion, 0..kMaxFusionViews - 1.
Stamp StampOfRank(int rank);

/// Composes the context of one reference view, of maps on the device that is to run it.
class FusionSetup {
 public:
  /// @param target_from_reference from the reference camera to the frame in which points are wanted
  FusionSetup(const PosedCamera& camera, const FusionMaps& maps, const FusionLimits& limits,
              const RigidTransform& target_from_reference);

  /// For fusion: the reference's stamps and its place in the order of fusion.
  void SetStamps(const ImageView<Stamp>& stamps, Stamp current) {
    context_.stamps = stamps;
    context_.current = current;
  }

  /// @param stamps the source's, for fusion
  void AddSource(const PosedCamera& camera, const FusionMaps& maps, const ImageView<Stamp>& stamps);

  const PinholeCamera& camera() const { return camera_.camera; }  ///< the reference's
  const FusionMaps& reference() const { return context_.reference; }
  const std::vector<FusionSource>& sources() const { return sources_; }

  /// @param sources where the device finds a copy of sources()
  FusionContext Context(const FusionSource* sources) const {
    FusionContext context = context_;
    context.sources = sources;
    context.num_sources = static_cast<int>(sources_.size());
    return context;
  }

 private:
  PosedCamera camera_;
  RigidTransform target_from_reference_;
  FusionContext context_ = {};
  std::vector<FusionSource> sources_;
};

// The host's, of maps in its memory.

/// LogOdds of all pixels of the reference.
Image<float> MeasureOdds(const FusionContext& context);

/// DepthEngine::FilterByConsistency (FusionOptions; paper, "Fusion"): checks the reference against the sources, which
/// are neither changed nor marked. A source's depth is that of its nearest pixel's plane at the place (DepthAtPlace),
/// with min_consistent_views > 0 that of the pixel, but for the confidence; a pixel without a normal agrees with
/// nothing. Points come in row-major order.
ConsistencyResult FilterByConsistency(const FusionSetup& setup);

/// DepthEngine::FuseView: its points; stamps the pixels that they used.
PointCloud FuseView(const FusionSetup& setup);

}  // namespace acmp
