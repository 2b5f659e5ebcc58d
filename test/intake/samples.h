#pragma once

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/intake/sensor_samples.h"

namespace acmp {

constexpr int64_t kMs = 1000000;
constexpr int64_t kS = 1000 * kMs;
constexpr int64_t kT0 = 1403636579763555500;  ///< a stamp of today's size, which doubles cannot hold

constexpr PinholeCamera kVgaCamera = {640, 480, 500, 500, 319.5, 239.5};

inline PoseSample PoseAt(int64_t stamp_ns, double x = 0) {
  PoseSample pose;
  pose.stamp_ns = stamp_ns;
  pose.received.translation().x() = x;
  return pose;
}

}  // namespace acmp
