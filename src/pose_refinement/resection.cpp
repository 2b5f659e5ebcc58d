#include "resection.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>

namespace acmp {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

}  // namespace

ViewPose Resect(const std::vector<SeenPoint>& points, const PinholeCamera& camera, const ViewPose& start) {
  constexpr double kSigma = 0.5;  // px: what the camera's errors leave
  constexpr int kIterations = 10;
  constexpr double kNoGain_px = 1e-3;  // root mean square: what a step must move pixels by to be worth another one
  ViewPose pose = start;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Matrix6 h = Matrix6::Zero();
    Vector6 g = Vector6::Zero();
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    for (const SeenPoint& seen : points) {
      const Eigen::Vector3d y = rotation * (seen.point - pose.centre);
      if (!(y.z() > 0)) continue;
      const Eigen::Vector2d r = camera.Project(y) - seen.pixel;
      const double inverse_z = 1 / y.z(), weight = 1 / (1 + r.squaredNorm() / (kSigma * kSigma));
      Eigen::Matrix<double, 2, 3> j;
      j << camera.fx * inverse_z, 0, -camera.fx * y.x() * inverse_z * inverse_z, 0, camera.fy * inverse_z,
          -camera.fy * y.y() * inverse_z * inverse_z;
      Eigen::Matrix<double, 2, 6> a;
      a << -j * CrossMatrix(y), -j * rotation;
      h += weight * a.transpose() * a;
      g += weight * a.transpose() * r;
    }
    const Eigen::LDLT<Matrix6> ldlt(h);
    if (ldlt.info() != Eigen::Success || !ldlt.isPositive() || !(ldlt.rcond() > 1e-14)) return start;
    const Vector6 step = -ldlt.solve(g);
    if (!step.allFinite()) return start;
    pose.rotation = (RotationAbout(step.head<3>()) * pose.rotation).normalized();
    pose.centre += step.tail<3>();
    if (-step.dot(g) < kNoGain_px * kNoGain_px * static_cast<double>(points.size())) break;
  }
  return pose;
}

std::vector<ViewPose> ResectViews(const Bundle& bundle, const CameraErrors& camera, size_t first_view) {
  const std::vector<CameraMotion> motions = MotionsOf(bundle);
  const Eigen::Vector3d errors(camera.k1, camera.k2, camera.readout);
  std::vector<std::vector<SeenPoint>> seen(bundle.size());
  for (const Landmark& landmark : bundle.landmarks) {
    if (landmark.held_out || !(landmark.inverse_depth > 0)) continue;
    const auto anchor = static_cast<size_t>(landmark.anchor);
    const ViewPose& pose = bundle.poses[anchor];
    const PinholeCamera& anchor_camera = bundle.cameras[anchor];
    const PixelErrors pixel_errors = PixelErrorsAt(anchor_camera, landmark.pixel, pose, motions[anchor],
                                                   anchor_camera.Unproject(landmark.pixel), landmark.inverse_depth);
    const Eigen::Vector2d ideal = landmark.pixel - pixel_errors.by_parameter * errors;
    const Eigen::Vector3d point =
        pose.rotation.conjugate() * anchor_camera.Unproject(ideal, 1 / landmark.inverse_depth) + pose.centre;
    seen[anchor].push_back({point, landmark.pixel});
    for (const Sighting& sighting : landmark.sightings) {
      seen[static_cast<size_t>(sighting.view)].push_back({point, sighting.pixel});
    }
  }
  constexpr size_t kMinPoints = 15;
  std::vector<ViewPose> poses(bundle.poses.begin() + static_cast<std::ptrdiff_t>(first_view), bundle.poses.end());
  tbb::parallel_for(first_view, bundle.size(), [&](size_t i) {
    ViewPose& pose = poses[i - first_view];
    if (seen[i].size() >= kMinPoints) pose = Resect(seen[i], bundle.cameras[i], pose);
  });
  return poses;
}

}  // namespace acmp
