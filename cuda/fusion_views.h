#pragma once

#include <vector>

#include "acmp_mapping/engine/matching_engine.h"
#include "acmp_mapping/fusion/fusion_setup.h"
#include "device_queue.h"
#include "fusion_kernels.h"

namespace acmp {

// An engine's views as the fusion's kernels read them. Views without a frame, reference views without an estimate and
// estimates of another size or device are an InvalidInputError.

PosedCamera PosedCameraOf(const EngineView& view);

/// Without colours.
DeviceFusionView GeometryMapsOf(const EngineView& view, DeviceQueue* queue);
/// With colours, where the frame has some.
DeviceFusionView FusionMapsOf(const EngineView& view, DeviceQueue* queue);

/// The reference's estimate against the sources' in the reference's camera frame.
/// @param maps_of GeometryMapsOf or FusionMapsOf
FusionSetup<DeviceFusionView> SetUpViews(const EngineView& reference, const std::vector<EngineView>& sources,
                                         const FusionLimits& limits,
                                         DeviceFusionView (*maps_of)(const EngineView&, DeviceQueue*),
                                         DeviceQueue* queue);

}  // namespace acmp
