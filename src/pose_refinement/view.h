#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/mask.h"
#include "gray_pyramid.h"

namespace acmp {

/// Axis times angle, the shorter way round.
inline Eigen::Vector3d RotationVector(const Eigen::Quaterniond& rotation) {
  const Eigen::Vector3d v = rotation.w() < 0 ? Eigen::Vector3d(-rotation.vec()) : Eigen::Vector3d(rotation.vec());
  const double sine = v.norm(), cosine = std::abs(rotation.w());
  return sine < 1e-12 ? Eigen::Vector3d(2 * v) : Eigen::Vector3d(2 * std::atan2(sine, cosine) / sine * v);
}

inline Eigen::Quaterniond RotationAbout(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  if (angle < 1e-12) return Eigen::Quaterniond(1, vector.x() / 2, vector.y() / 2, vector.z() / 2).normalized();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector / angle));
}

inline Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  return (Eigen::Matrix3d() << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0).finished();
}

/// Orientation and place of a camera. Errors of a direction do not move the centre, so that the two can be adjusted
/// apart.
struct ViewPose {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< cam_from_world
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();              ///< in the world
};

inline ViewPose ToViewPose(const RigidTransform& cam_from_world) {
  ViewPose pose;
  pose.rotation = Eigen::Quaterniond(cam_from_world.rotation()).normalized();
  pose.centre = -(cam_from_world.rotation().transpose() * cam_from_world.translation());
  return pose;
}

inline RigidTransform ToRigidTransform(const ViewPose& pose) {
  RigidTransform cam_from_world = RigidTransform::Identity();
  cam_from_world.linear() = pose.rotation.toRotationMatrix();
  cam_from_world.translation() = -(cam_from_world.linear() * pose.centre);
  return cam_from_world;
}

/// An image to find landmarks in.
struct View {
  PinholeCamera camera;
  GrayPyramid pyramid;
  MaskDistanceMap mask_distance;  ///< of its mask; empty: all pixels count

  /// Whether the mask ignores no pixel within `reach` px of a place in the image, along both axes.
  bool IsClear(const Eigen::Vector2d& pixel, double reach) const {
    if (mask_distance.empty()) return true;
    const int col = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, mask_distance.width() - 1);
    const int row = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, mask_distance.height() - 1);
    return mask_distance(col, row) > reach;
  }
};

/// Where a landmark is seen.
struct Sighting {
  int view = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

/// A point of the scene: a pixel of its anchor view, taken as exact, and the inverse of its depth z there. Its place in
/// the other views is measured against the anchor's pixels.
struct Landmark {
  int anchor = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double inverse_depth = 0;  ///< 1 / scene unit
  bool held_out = false;     ///< takes no part in any adjustment
  std::vector<Sighting> sightings;
};

/// (z in the view) / (z in the anchor) times the direction to the landmark in the view's frame: a point of the ray, and
/// with it the projection, also for landmarks at infinity.
inline Eigen::Vector3d DirectionInView(const Eigen::Vector3d& anchor_ray, double inverse_depth, const ViewPose& anchor,
                                       const ViewPose& view) {
  return view.rotation * (anchor.rotation.conjugate() * anchor_ray + inverse_depth * (anchor.centre - view.centre));
}

}  // namespace acmp
