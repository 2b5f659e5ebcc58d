#pragma once

#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/fusion/kernel/fusion_context.h"
#include "acmp_mapping/geometry/posed_camera.h"

namespace acmp {

/// What ConsistencyResult's counts, a byte each, can hold.
constexpr int kMaxFusionSources = 255;
constexpr int kMaxFusionViews = kUnfusedStamp;  ///< with a stamp each

inline PosedCamera CameraOf(const FusionView& view) { return {view.camera, view.cam_from_world}; }

FusionLimits MakeFusionLimits(const FusionOptions& options);

/// @param target_from_reference from the reference camera to the frame in which points are wanted
ReferenceGeometry MakeReferenceGeometry(const PosedCamera& reference, const RigidTransform& target_from_reference);
SourceGeometry MakeSourceGeometry(const PosedCamera& reference, const PosedCamera& source,
                                  const RigidTransform& target_from_reference);

/// Throws InvalidInputError unless a stamp can hold the view's place in the order of fusion, 0..kMaxFusionViews - 1.
Stamp StampOfRank(int rank);

/// What FusionEngine::FusedPixels says of a frame's stamps, and stamps that say the same in a fusion that goes on.
Image<unsigned char> FusedOf(const ImageView<const Stamp>& stamps);
/// Throws InvalidInputError unless `used` has the size of the camera's image.
Image<Stamp> StampsOfFused(const Image<unsigned char>& used, const PinholeCamera& camera);

/// Composes the context of one reference view. `View` is the FusionMaps of the device that is to run it.
template <class View>
class FusionSetup {
 public:
  /// @param target_from_reference from the reference camera to the frame in which points are wanted
  FusionSetup(const PosedCamera& camera, const View& maps, const FusionLimits& limits,
              const RigidTransform& target_from_reference)
      : camera_(camera), target_from_reference_(target_from_reference) {
    context_.geometry = MakeReferenceGeometry(camera, target_from_reference);
    context_.reference = maps;
    context_.limits = limits;
  }

  /// For fusion: the reference's stamps and its place in the order of fusion.
  void SetStamps(const ImageView<Stamp>& stamps, Stamp current) {
    context_.stamps = stamps;
    context_.current = current;
  }

  /// @param stamps the source's, for fusion
  void AddSource(const PosedCamera& camera, const View& maps, const ImageView<Stamp>& stamps = {}) {
    sources_.push_back({MakeSourceGeometry(camera_, camera, target_from_reference_), maps, stamps});
  }

  const View& reference() const { return context_.reference; }
  const std::vector<FusionSource<View>>& sources() const { return sources_; }

  /// @param sources where the device finds a copy of sources()
  FusionContext<View> Context(const FusionSource<View>* sources) const {
    FusionContext<View> context = context_;
    context.sources = sources;
    context.num_sources = static_cast<int>(sources_.size());
    return context;
  }

 private:
  PosedCamera camera_;
  RigidTransform target_from_reference_;
  FusionContext<View> context_ = {};
  std::vector<FusionSource<View>> sources_;
};

/// FusionEngine::FuseView on the host: appends its points and stamps the pixels that they used.
void FuseView(const FusionSetup<FusionMaps<Vec3f>>& setup, PointCloud* points);

/// LogOdds of all pixels of the reference.
Image<float> MeasureOdds(const FusionContext<FusionMaps<Vec3f>>& context);

/// The host's maps as the kernel functions read them.
inline FusionMaps<Vec3f> MapsOf(const FusionView& view) { return {view.depth, view.normal, view.cost, view.color}; }

/// Throws InvalidInputError for what FilterByConsistency does not take, and for more than `max_sources` sources.
void CheckConsistencyInput(const FusionView& reference, const std::vector<FusionView>& sources, int max_sources);

}  // namespace acmp
