#include "stamp_offset.h"

#include <algorithm>
#include <cmath>

#include "align_views.h"
#include "rotation_vector.h"

namespace acmp {
namespace {

constexpr size_t kMinViews = 10;
/// Of the squared rotations from refined to received poses, that an offset explains. Without one, rotations of recorded
/// frontends are explained by up to 0.8, but then by offsets of a few milliseconds.
constexpr double kMinExplained = 0.7;
constexpr double kMinOffset_s = 0.01;  ///< half a degree where the camera turns by a rad/s, a fast turn by hand

/// Of the camera at a view that is neither the first nor the last, rad/s, axes of the world. Poses are cam_from_world.
Eigen::Vector3d AngularVelocity(const Bundle& bundle, size_t view) {
  const ViewPose &before = bundle.received[view - 1], &after = bundle.received[view + 1];
  const Eigen::Vector3d turn = RotationVector(after.rotation * before.rotation.conjugate());
  return bundle.received[view].rotation.conjugate() * turn / (bundle.times[view + 1] - bundle.times[view - 1]);
}

}  // namespace

std::optional<double> FindStampOffset(const Bundle& bundle) {
  const size_t views = bundle.size();
  if (views < kMinViews) return std::nullopt;
  // A constant velocity turns all poses alike, which the similarity between the two worlds takes up.
  const std::vector<ViewPose> refined = Moved(FitSimilarity(bundle.poses, bundle.received, views), bundle.poses);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (size_t i = 1; i + 1 < views; ++i) mean += AngularVelocity(bundle, i) / static_cast<double>(views - 2);
  double velocities = 0, products = 0, errors = 0;
  for (size_t i = 1; i + 1 < views; ++i) {
    const Eigen::Vector3d velocity = bundle.received[i].rotation * (AngularVelocity(bundle, i) - mean);
    const Eigen::Vector3d error = RotationVector(bundle.received[i].rotation * refined[i].rotation.conjugate());
    velocities += velocity.squaredNorm();
    products += velocity.dot(error);
    errors += error.squaredNorm();
  }
  if (!(velocities > 0 && errors > 0)) return std::nullopt;
  const double offset = products / velocities;
  if (products * offset < kMinExplained * errors || std::abs(offset) < kMinOffset_s) return std::nullopt;
  return offset;
}

}  // namespace acmp
