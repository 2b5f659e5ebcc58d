#pragma once

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// A camera and where it stands.
struct PosedCamera {
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
};

}  // namespace acmp
