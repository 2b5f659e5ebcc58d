#include "acmp_mapping/intake/convention_check.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr size_t kSample = 1000;          ///< points of a cloud looked at: a cloud may be a whole map
constexpr double kPlausibleFront = 0.5;   ///< of the points in front of the camera
constexpr double kClearlyBetter = 1.5;    ///< times as many points in the image
constexpr double kConvincingImage = 0.6;  ///< of the points in the image

using Direction = PoseSemantics::Direction;
using Child = PoseSemantics::Child;

long Percent(double share) { return std::lround(100 * share); }

/// Other meanings that the same pose could have, with the parameters that would declare them.
std::vector<std::pair<std::string, PoseSemantics>> OtherSemantics(const PoseSemantics& configured) {
  std::vector<std::pair<std::string, PoseSemantics>> others;
  for (const Direction direction : {Direction::kWorldFromCam, Direction::kCamFromWorld}) {
    for (const Child child : {Child::kCameraOptical, Child::kCameraFlu, Child::kBody}) {
      const bool same = direction == configured.direction && child == configured.child;
      if (same || (child == Child::kBody && !configured.body_from_cam)) continue;
      const PoseSemantics other{direction, child, configured.body_from_cam};
      others.emplace_back(Concat("~pose_is: ", Name(direction), ", ~pose_child: ", Name(child)), other);
    }
  }
  if (configured.child == Child::kBody) {
    others.emplace_back("T_body_cam inverted (~extrinsic_inverted)",
                        PoseSemantics{configured.direction, Child::kBody, configured.body_from_cam->inverse()});
  }
  return others;
}

}  // namespace

std::optional<std::string> ConventionCheck::Add(const PoseSemantics& configured, const RigidTransform& cloud_received,
                                                const SparseCloud& cloud, bool cloud_in_camera,
                                                const PinholeCamera& camera) {
  if (keyframes_ >= kLastKeyframes || !warning_.empty() || cloud.points.empty()) return std::nullopt;
  points_ += std::min(cloud.points.size(), kSample);
  const RigidTransform cam_from_world = WorldFromCamera(configured, cloud_received).inverse();
  const RigidTransform same = RigidTransform::Identity();
  Count("as configured", cloud_in_camera ? same : cam_from_world, cloud, camera);
  Count(cloud_in_camera ? "~sparse_frame: world" : "~sparse_frame: camera", cloud_in_camera ? cam_from_world : same,
        cloud, camera);
  if (!cloud_in_camera) {
    for (const auto& [name, semantics] : OtherSemantics(configured)) {
      Count(name, WorldFromCamera(semantics, cloud_received).inverse(), cloud, camera);
    }
  }
  ++keyframes_;
  if (keyframes_ < kKeyframes || keyframes_ % kKeyframes != 0) return std::nullopt;
  const int times = keyframes_ / kKeyframes;
  if ((times & (times - 1)) != 0) return std::nullopt;  // not yet doubled
  std::optional<std::string> warning = Judge(configured);
  if (warning) warning_ = *warning;
  return warning;
}

void ConventionCheck::Count(const std::string& name, const RigidTransform& cam_from_cloud, const SparseCloud& cloud,
                            const PinholeCamera& camera) {
  auto reading =
      std::find_if(readings_.begin(), readings_.end(), [&](const Reading& known) { return known.name == name; });
  if (reading == readings_.end()) reading = readings_.insert(readings_.end(), Reading{name});
  const size_t sampled = std::min(cloud.points.size(), kSample);
  for (size_t i = 0; i < sampled; ++i) {
    // Spread over the whole cloud.
    const Eigen::Vector3d point = cam_from_cloud * cloud.points[i * cloud.points.size() / sampled];
    if (!(point.z() > 0)) continue;
    ++reading->in_front;
    reading->in_image += camera.Contains(camera.Project(point));
  }
}

std::optional<std::string> ConventionCheck::Judge(const PoseSemantics& configured) const {
  const Reading& now = readings_.front();
  const auto best = std::max_element(readings_.begin() + 1, readings_.end(),
                                     [](const Reading& a, const Reading& b) { return a.in_image < b.in_image; });
  const double now_image = Share(now.in_image), best_image = Share(best->in_image);
  // Points that a keyframe observes lie in its image with the right reading; some do so by chance with wrong ones.
  const bool fits = best_image > kConvincingImage && best_image > kClearlyBetter * now_image;
  const bool plausible = Share(now.in_front) >= kPlausibleFront;
  if (plausible && !fits) return std::nullopt;
  const std::string found = Concat("of the sparse points of the first ", keyframes_, " keyframes ",
                                   Percent(Share(now.in_front)), " % lie in front of the camera and only ",
                                   Percent(now_image), " % in the image (poses read as ", Describe(configured), ")");
  const std::string other = Concat(best->name, ": ", Percent(best_image), " % in the image");
  if (fits) return Concat(found, "; with ", other, ": set this");
  return Concat(
      found, "; no other reading fits (best: ", other,
      "): are they poses of the camera (those of an IMU or a robot need ~pose_child: body and T_body_cam), and "
      "the points in the poses' world (~sparse_frame)? A cloud of a whole map may look like this, too");
}

std::optional<double> ConventionCheck::share_in_front() const {
  if (points_ == 0) return std::nullopt;
  return Share(readings_.front().in_front);
}

}  // namespace acmp
