#include "bundle.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace acmp {
namespace {

Eigen::Vector3d MeanCentre(const std::vector<ViewPose>& poses) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const ViewPose& pose : poses) sum += pose.centre;
  return sum / static_cast<double>(poses.size());
}

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

}  // namespace

ViewPose Bundle::FromOrigin(const RigidTransform& received_cam_from_world) const {
  ViewPose pose = ToViewPose(received_cam_from_world);
  pose.centre -= origin;
  return pose;
}

void Bundle::Add(int64_t id, double time, const PinholeCamera& camera, const RigidTransform& received_cam_from_world) {
  ids.push_back(id);
  times.push_back(time);
  cameras.push_back(camera);
  cam_from_world.push_back(received_cam_from_world);
  received.push_back(FromOrigin(received_cam_from_world));
  poses.push_back(received.back());
}

std::vector<CameraMotion> MotionsOf(const Bundle& bundle) {
  std::vector<CameraMotion> motions(bundle.size());
  for (size_t i = 0; i < bundle.size(); ++i) {
    const size_t a = i == 0 ? 0 : i - 1, b = std::min(i + 1, bundle.size() - 1);
    const double interval = bundle.times[b] - bundle.times[a];
    if (!(interval > 0)) continue;
    motions[i].angular = RotationVector(bundle.poses[b].rotation * bundle.poses[a].rotation.conjugate()) / interval;
    motions[i].linear = (bundle.poses[b].centre - bundle.poses[a].centre) / interval;
  }
  return motions;
}

Eigen::Matrix<double, 2, 3> PixelErrorsAt(const Bundle& bundle, const std::vector<CameraMotion>& motions, size_t view,
                                          const Eigen::Vector2d& pixel, const Eigen::Vector3d& direction,
                                          double inverse_length) {
  Eigen::Matrix<double, 2, 3> errors;
  const PinholeCamera& camera = bundle.cameras[view];
  const CameraMotion& motion = motions[view];
  const Eigen::Vector2d x((pixel.x() - camera.cx) / camera.fx, (pixel.y() - camera.cy) / camera.fy);
  const double r2 = x.squaredNorm();
  const Eigen::Vector2d radial(camera.fx * x.x(), camera.fy * x.y());
  errors.col(0) = radial * r2;
  errors.col(1) = radial * r2 * r2;
  const Eigen::Vector3d d = direction / direction.z();
  const Eigen::Vector3d velocity =
      motion.angular.cross(d) - (inverse_length / direction.z()) * (bundle.poses[view].rotation * motion.linear);
  const Eigen::Vector2d flow(camera.fx * (velocity.x() - d.x() * velocity.z()),
                             camera.fy * (velocity.y() - d.y() * velocity.z()));
  errors.col(2) = ((pixel.y() + 0.5) / camera.height - 0.5) * flow;
  return errors;
}

Bundle FreedFrom(const CameraErrors& camera, Bundle bundle) {
  const std::vector<CameraMotion> motions = MotionsOf(bundle);
  const auto error = [&](size_t view, const Eigen::Vector2d& pixel, const Eigen::Vector3d& direction,
                         double inverse) -> Eigen::Vector2d {
    return PixelErrorsAt(bundle, motions, view, pixel, direction, inverse) * ToVector(camera);
  };
  for (Landmark& landmark : bundle.landmarks) {
    const auto anchor = static_cast<size_t>(landmark.anchor);
    const Eigen::Vector3d ray = bundle.cameras[anchor].Unproject(landmark.pixel);
    for (Sighting& sighting : landmark.sightings) {
      const auto view = static_cast<size_t>(sighting.view);
      const Eigen::Vector3d y = DirectionInView(ray, landmark.inverse_depth, bundle.poses[anchor], bundle.poses[view]);
      if (y.z() > 0) sighting.pixel -= error(view, sighting.pixel, y, landmark.inverse_depth);
    }
    landmark.pixel -= error(anchor, landmark.pixel, ray, landmark.inverse_depth);
  }
  return bundle;
}

std::vector<Eigen::Vector2d> ErrorsOf(const Landmark& landmark, const Bundle& bundle,
                                      const std::vector<ViewPose>& poses) {
  std::vector<Eigen::Vector2d> errors;
  const auto anchor = static_cast<size_t>(landmark.anchor);
  const Eigen::Vector3d ray = bundle.cameras[anchor].Unproject(landmark.pixel);
  for (const Sighting& sighting : landmark.sightings) {
    const auto view = static_cast<size_t>(sighting.view);
    const Eigen::Vector3d y = DirectionInView(ray, landmark.inverse_depth, poses[anchor], poses[view]);
    if (y.z() > 0) errors.push_back(bundle.cameras[view].Project(y) - sighting.pixel);
  }
  return errors;
}

void Triangulate(const std::vector<ViewPose>& poses, const std::vector<PinholeCamera>& cameras, Landmark* landmark) {
  const ViewPose& anchor = poses[static_cast<size_t>(landmark->anchor)];
  const Eigen::Vector3d ray = cameras[static_cast<size_t>(landmark->anchor)].Unproject(landmark->pixel);
  for (int iteration = 0; iteration < 8; ++iteration) {
    double h = 0, g = 0;
    for (const Sighting& sighting : landmark->sightings) {
      const ViewPose& pose = poses[static_cast<size_t>(sighting.view)];
      const PinholeCamera& camera = cameras[static_cast<size_t>(sighting.view)];
      const Eigen::Vector3d y = DirectionInView(ray, landmark->inverse_depth, anchor, pose);
      if (!(y.z() > 0)) continue;
      const Eigen::Vector2d r = camera.Project(y) - sighting.pixel;
      const Eigen::Vector3d d = pose.rotation * (anchor.centre - pose.centre);
      const Eigen::Vector2d j(camera.fx * (d.x() - y.x() / y.z() * d.z()) / y.z(),
                              camera.fy * (d.y() - y.y() / y.z() * d.z()) / y.z());
      const double weight = 1 / (1 + r.squaredNorm());
      h += weight * j.squaredNorm(), g += weight * j.dot(r);
    }
    if (!(h > 0)) return;
    const double step = g / h;
    landmark->inverse_depth -= step;
    if (std::abs(step) < 1e-5 * std::abs(landmark->inverse_depth)) return;
  }
}

double DistortionShift(const PinholeCamera& camera, const CameraErrors& errors, double place) {
  const double x = std::max(camera.cx, camera.width - 1 - camera.cx) / camera.fx;
  const double y = std::max(camera.cy, camera.height - 1 - camera.cy) / camera.fy;
  const double r = place * std::hypot(x, y), r2 = r * r;
  return camera.fx * r * (errors.k1 * r2 + errors.k2 * r2 * r2);
}

double Extent(const std::vector<ViewPose>& poses) {
  const Eigen::Vector3d mean = MeanCentre(poses);
  double extent = 0;
  for (const ViewPose& pose : poses) extent = std::max(extent, (pose.centre - mean).norm());
  return extent;
}

bool Stands(const std::vector<ViewPose>& poses, double depth) {
  constexpr double kStill = 0.01;
  return Extent(poses) < kStill * depth;
}

std::vector<PosePair> PairsOf(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count) {
  std::vector<PosePair> pairs;
  for (size_t i = 0; i < count; ++i) {
    pairs.push_back({ToRigidTransform(from[i]).inverse(), ToRigidTransform(to[i]).inverse()});
  }
  return pairs;
}

Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count, double depth,
                         double known_scale) {
  Similarity fit = FitSimilarity(PairsOf(from, to, count));
  if (count < kMinForSimilarity) return fit;
  const auto end = static_cast<std::ptrdiff_t>(count);
  const std::vector<ViewPose> first_from(from.begin(), from.begin() + end), first_to(to.begin(), to.begin() + end);
  if (Stands(first_from, depth) || Stands(first_to, known_scale * depth)) {
    fit.scale = known_scale;
    fit.rigid.translation() = MeanCentre(first_to) - fit.rigid.linear() * (fit.scale * MeanCentre(first_from));
  }
  return fit;
}

std::vector<ViewPose> Moved(const Similarity& similarity, std::vector<ViewPose> poses) {
  const Eigen::Quaterniond world_from_old(similarity.rigid.linear());
  for (ViewPose& pose : poses) {
    pose = {(pose.rotation * world_from_old.conjugate()).normalized(),
            similarity.rigid * (similarity.scale * pose.centre)};
  }
  return poses;
}

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
  std::vector<std::vector<SeenPoint>> seen(bundle.size());
  for (const Landmark& landmark : bundle.landmarks) {
    if (landmark.held_out || !(landmark.inverse_depth > 0)) continue;
    const auto anchor = static_cast<size_t>(landmark.anchor);
    const ViewPose& pose = bundle.poses[anchor];
    const PinholeCamera& anchor_camera = bundle.cameras[anchor];
    const Eigen::Vector2d ideal =
        landmark.pixel - PixelErrorsAt(bundle, motions, anchor, landmark.pixel, anchor_camera.Unproject(landmark.pixel),
                                       landmark.inverse_depth) *
                             ToVector(camera);
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
