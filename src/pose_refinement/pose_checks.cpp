#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/median.h"
#include "bundle_refinement.h"

namespace acmp {
namespace {

constexpr size_t kMinViewsToJudge = 6;
// Among these views: where there are fewer, refined poses follow the received ones.
constexpr int kMinSightingsToJudge = 250;

int NumSightings(const Bundle& bundle, int first) {
  int sightings = 0;
  for (const Landmark& landmark : bundle.landmarks) {
    if (landmark.anchor < first) continue;
    sightings += static_cast<int>(std::count_if(landmark.sightings.begin(), landmark.sightings.end(),
                                                [first](const Sighting& sighting) { return sighting.view >= first; }));
  }
  return sightings;
}

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

std::optional<double> MeasureContradiction(const Bundle& bundle, double known_scale) {
  const size_t views = std::min(kContradictionImages, bundle.size());
  const size_t first = bundle.size() - views;
  if (views < kMinViewsToJudge || NumSightings(bundle, static_cast<int>(first)) < kMinSightingsToJudge)
    return std::nullopt;
  const auto last = [first](const std::vector<ViewPose>& poses) {
    return std::vector<ViewPose>(poses.begin() + static_cast<std::ptrdiff_t>(first), poses.end());
  };
  const std::vector<ViewPose> received = last(bundle.received);
  const double depth = TypicalDepth(bundle), received_depth = known_scale * depth;
  if (Stands(bundle.received, received_depth)) return std::nullopt;  // without a baseline landmarks have no depth
  // Both stand: seen from one place landmarks have hardly a depth that distances could be compared with.
  constexpr double kNoMove = 0.1;  // of the window's extent
  if (Stands(received, received_depth) && Extent(last(bundle.poses)) < kNoMove * Extent(bundle.received)) return 0;
  const Similarity received_from_refined = FitSimilarity(last(bundle.poses), received, views, depth, known_scale);
  const std::vector<ViewPose> refined = Moved(received_from_refined, last(bundle.poses));
  std::vector<double> angles, distances;
  for (size_t i = 0; i < views; ++i) {
    angles.push_back(RotationVector(refined[i].rotation * received[i].rotation.conjugate()).norm());
    distances.push_back((refined[i].centre - received[i].centre).norm());
  }
  return Median(std::move(angles)) + Median(std::move(distances)) / (received_from_refined.scale * depth);
}

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
