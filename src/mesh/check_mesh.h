#pragma once

#include "acmp_mapping/mesh/distance_volume.h"

namespace acmp {

/// Throws InvalidInputError naming the first value out of bounds.
void CheckVolumeOptions(const DistanceVolumeOptions& options);
void CheckSurfaceView(const SurfaceView& view);

}  // namespace acmp
