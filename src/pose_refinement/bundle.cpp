#include "bundle.h"

#include <algorithm>
#include <cmath>

namespace acmp {
namespace {

CameraMotion MotionBetween(const Bundle& bundle, size_t a, size_t b) {
  CameraMotion motion;
  const double interval = bundle.times[b] - bundle.times[a];
  if (!(interval > 0)) return motion;
  motion.angular = RotationVector(bundle.poses[b].rotation * bundle.poses[a].rotation.conjugate()) / interval;
  motion.linear = (bundle.poses[b].centre - bundle.poses[a].centre) / interval;
  return motion;
}

Eigen::Vector3d MeanCentre(const std::vector<ViewPose>& poses) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const ViewPose& pose : poses) sum += pose.centre;
  return sum / static_cast<double>(poses.size());
}

}  // namespace

std::vector<CameraMotion> MotionsOf(const Bundle& bundle) {
  std::vector<CameraMotion> motions(bundle.size());
  for (size_t i = 0; i < bundle.size(); ++i) {
    if (bundle.motions[i]) {
      motions[i] = *bundle.motions[i];
      continue;
    }
    motions[i] = MotionBetween(bundle, i == 0 ? 0 : i - 1, std::min(i + 1, bundle.size() - 1));
  }
  return motions;
}

PixelErrors PixelErrorsAt(const PinholeCamera& camera, const Eigen::Vector2d& pixel, const ViewPose& pose,
                          const CameraMotion& motion, const Eigen::Vector3d& direction, double inverse_length) {
  PixelErrors errors;
  const Eigen::Vector2d x((pixel.x() - camera.cx) / camera.fx, (pixel.y() - camera.cy) / camera.fy);
  const double r2 = x.squaredNorm();
  const Eigen::Vector2d radial(camera.fx * x.x(), camera.fy * x.y());
  errors.by_parameter.col(0) = radial * r2;
  errors.by_parameter.col(1) = radial * r2 * r2;
  const Eigen::Vector3d d = direction / direction.z();
  const Eigen::Vector3d velocity =
      motion.angular.cross(d) - (inverse_length / direction.z()) * (pose.rotation * motion.linear);
  const Eigen::Vector2d flow(camera.fx * (velocity.x() - d.x() * velocity.z()),
                             camera.fy * (velocity.y() - d.y() * velocity.z()));
  errors.by_parameter.col(2) = ((pixel.y() + 0.5) / camera.height - 0.5) * flow;
  return errors;
}

Bundle FreedFrom(const CameraErrors& camera, Bundle bundle) {
  const std::vector<CameraMotion> motions = MotionsOf(bundle);
  const Eigen::Vector3d errors(camera.k1, camera.k2, camera.readout);
  const auto error = [&](size_t view, const Eigen::Vector2d& pixel, const Eigen::Vector3d& direction,
                         double inverse) -> Eigen::Vector2d {
    return PixelErrorsAt(bundle.cameras[view], pixel, bundle.poses[view], motions[view], direction, inverse)
               .by_parameter *
           errors;
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

Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count, double depth,
                         double known_scale) {
  std::vector<PosePair> pairs;
  for (size_t i = 0; i < count; ++i) {
    pairs.push_back({ToRigidTransform(from[i]).inverse(), ToRigidTransform(to[i]).inverse()});
  }
  Similarity fit = FitSimilarity(pairs);
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

}  // namespace acmp
