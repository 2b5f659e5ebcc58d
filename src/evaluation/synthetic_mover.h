#pragma once

#include "acmp_mapping/evaluation/synthetic_scene.h"
#include "synthetic_world.h"

namespace acmp {

/// The place as it is when image `index` is taken: with something textured that goes along with the camera at 3/10 of
/// its speed. To whoever takes it for a part of the place, it stands 1.4 times as far away as it is: most views agree.
/// It is the last of the objects.
SyntheticWorld WithMovingObject(const SyntheticWorld& world, int index, const SyntheticSceneOptions& options);

/// Ignores the pixels that show the last object of `world`, and those around that lens, shutter and the pixels' area
/// may have mixed with it.
Mask MaskOfLastObject(const SyntheticWorld& world, const PinholeCamera& camera, const CameraPose& pose,
                      const ImagingModel& imaging);

}  // namespace acmp
