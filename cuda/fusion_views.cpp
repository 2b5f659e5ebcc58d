#include "fusion_views.h"

#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_estimate.h"
#include "cuda_image.h"

namespace acmp {

PosedCamera PosedCameraOf(const EngineView& view) {
  if (!view.frame) throw InvalidInputError("frame: must not be null");
  return {view.frame->camera, view.cam_from_world()};
}

DeviceFusionView GeometryMapsOf(const EngineView& view, DeviceQueue* queue) {
  const PosedCamera camera = PosedCameraOf(view);
  const CudaEstimate& estimate = queue->Cast<CudaEstimate>(view.estimate);
  CheckSize("estimate", estimate.width, estimate.height, camera.camera);
  return {estimate.DepthView(), estimate.PlaneView(), estimate.CostView(), {}};
}

DeviceFusionView FusionMapsOf(const EngineView& view, DeviceQueue* queue) {
  DeviceFusionView maps = GeometryMapsOf(view, queue);
  maps.color = ColorOf(view, queue);
  return maps;
}

FusionSetup<DeviceFusionView> SetUpViews(const EngineView& reference, const std::vector<EngineView>& sources,
                                         const FusionLimits& limits,
                                         DeviceFusionView (*maps_of)(const EngineView&, DeviceQueue*),
                                         DeviceQueue* queue) {
  FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), maps_of(reference, queue), limits,
                                      RigidTransform::Identity());
  for (const EngineView& source : sources) {
    if (source.estimate) setup.AddSource(PosedCameraOf(source), maps_of(source, queue));
  }
  return setup;
}

}  // namespace acmp
