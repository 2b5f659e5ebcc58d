#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/similarity.h"
#include "acmp_mapping/pose_refinement/pose_refinement.h"

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

/// Views, what is known of their poses, and landmarks seen in them.
struct Bundle {
  std::vector<int64_t> ids;
  std::vector<double> times;  ///< of the exposures, ascending; the unit of CameraErrors::readout
  std::vector<PinholeCamera> cameras;
  std::vector<RigidTransform> cam_from_world;        ///< as received, bit by bit
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< in the world: centres are relative to it, for precision
  std::vector<ViewPose> received;
  std::vector<ViewPose> expected;  ///< what poses are held to: received ones, or near them
  std::vector<ViewPose> poses;     ///< the best known so far
  std::vector<Landmark> landmarks;

  size_t size() const { return cameras.size(); }

  ViewPose FromOrigin(const RigidTransform& received_cam_from_world) const;
  RigidTransform FromWorld(const ViewPose& pose) const {
    return ToRigidTransform({pose.rotation, pose.centre + origin});
  }

  /// Adds a view, whose pose is as received.
  void Add(int64_t id, double time, const PinholeCamera& camera, const RigidTransform& received_cam_from_world);
};

/// How the camera moved while an image was taken.
struct CameraMotion {
  Eigen::Vector3d angular = Eigen::Vector3d::Zero();  ///< rad/s, axes of the camera: cam_from_world(t) =
                                                      ///< exp(t angular) cam_from_world
  Eigen::Vector3d linear = Eigen::Vector3d::Zero();   ///< of the camera's centre, scene units/s, axes of the world
};
/// The motion at each view, from its neighbours in time.
std::vector<CameraMotion> MotionsOf(const Bundle& bundle);

inline Eigen::Vector3d ToVector(const CameraErrors& errors) { return {errors.k1, errors.k2, errors.readout}; }

/// How the camera's errors move a pixel of a view, px per unit of each: columns k1, k2, readout.
/// @param motions of all views
/// @param direction to the landmark in the view's frame, of any length
/// @param inverse_length (length of `direction`) / (distance), with sign: 1 / z where direction.z = 1
Eigen::Matrix<double, 2, 3> PixelErrorsAt(const Bundle& bundle, const std::vector<CameraMotion>& motions, size_t view,
                                          const Eigen::Vector2d& pixel, const Eigen::Vector3d& direction,
                                          double inverse_length);

/// The same bundle as a camera without errors would have seen it: pixels freed from them.
Bundle FreedFrom(const CameraErrors& camera, Bundle bundle);

/// Of a landmark's sightings, px: where pinholes at `poses` see it, less where it was seen. Left out where it lies
/// behind.
std::vector<Eigen::Vector2d> ErrorsOf(const Landmark& landmark, const Bundle& bundle,
                                      const std::vector<ViewPose>& poses);

/// The inverse depth that fits the sightings best (robust); keeps the landmark's own where they say nothing.
void Triangulate(const std::vector<ViewPose>& poses, const std::vector<PinholeCamera>& cameras, Landmark* landmark);

/// Whether a camera hardly moves: its positions lie within a hundredth of the depth, half of what maps may lie apart.
/// They then tell nothing of a scale: that would be one noise over another.
bool Stands(const std::vector<ViewPose>& poses, double depth);

/// Distance of the farthest centre from their mean.
double Extent(const std::vector<ViewPose>& poses);

/// The first `count` poses, world_from_cam.
std::vector<PosePair> PairsOf(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count);

/// FitSimilarity of the first `count` poses, but with the scale as it is known where the camera stands there.
/// @param depth typical one, in the world of `from`
/// @param known_scale lengths in the world of `to` of what is 1 in that of `from`
Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count,
                         double depth = 0, double known_scale = 1);

std::vector<ViewPose> Moved(const Similarity& similarity, std::vector<ViewPose> poses);

/// A known point and where a view sees it.
struct SeenPoint {
  Eigen::Vector3d point;  ///< world
  Eigen::Vector2d pixel;
};

/// The pose from which the points are seen best where their pixels are, from `start` on: robust Gauss-Newton (Cauchy).
/// Returns `start` where the points do not tell it.
ViewPose Resect(const std::vector<SeenPoint>& points, const PinholeCamera& camera, const ViewPose& start);

/// For each view the pose from which a pinhole camera without errors sees the adjusted landmarks best where their
/// pixels are: what whoever matches images as they are needs. A view with too few landmarks keeps its pose.
/// @param camera what has been found out about the cameras: anchors' pixels are freed from it
/// @param first_view views before it are left out
/// @return poses of the views from `first_view` on
std::vector<ViewPose> ResectViews(const Bundle& bundle, const CameraErrors& camera, size_t first_view = 0);

/// Standard deviations of what a bundle adjustment weighs against each other.
struct BundleWeights {
  double pixel_sigma = 0.3;      ///< px, of a sighting along each axis
  double rotation_sigma = 0.02;  ///< rad, of a received orientation about each axis
  double position_sigma = 0.05;  ///< scene units, of a received position along each axis
  double turn_sigma = 0.01;      ///< rad, of the received rotation from view to view about each axis
  double move_sigma = 0.02;      ///< scene units, of the received motion from view to view along each axis
  CameraErrors camera_sigma;     ///< of the camera's errors about what they were before
};

/// Adjusts poses, inverse depths of landmarks that are not held out, and the camera's errors. Robust (Cauchy); received
/// poses, received motions from view to view and the camera's errors are priors: a view without landmarks moves with
/// its neighbours. Poses are then those at the middle row of an image without distortion. The first `fixed_views` stay
/// as they are. One thread, so that results do not depend on the machine. Returns false, with the poses as they were,
/// where the solver finds no solution.
[[nodiscard]] bool AdjustBundle(const BundleWeights& weights, int max_iterations, size_t fixed_views, Bundle* bundle,
                                CameraErrors* camera);

}  // namespace acmp
