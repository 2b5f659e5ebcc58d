#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "acmp_mapping/image/image.h"
#include "synthetic_world.h"

namespace acmp {

/// One rendered image as the landmark maker reads it; what it points to belongs to the caller.
struct LandmarkView {
  const SyntheticWorld* world;
  PinholeCamera camera;
  CameraPose pose;
  const ColorImage* color;
  const DepthMap* depth;
  const Image<unsigned char>* low_texture;
};

/// Per view the sparse map points it observes, as a SLAM frontend would: corners on textured surfaces found view by
/// view where no earlier point is near, kept when at least three views (two when there are only two) see them, with a
/// position error of a few millimetres. A point has the same coordinates in all views that observe it; none is
/// occluded.
std::vector<std::vector<Eigen::Vector3d>> MakeLandmarks(const std::vector<LandmarkView>& views, uint32_t seed);

}  // namespace acmp
