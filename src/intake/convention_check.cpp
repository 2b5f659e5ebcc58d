#include "acmp_mapping/intake/convention_check.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"

namespace acmp {
namespace {

constexpr size_t kSample = 20000;         ///< points of a cloud looked at: a cloud may be a whole map
constexpr int kMostClouds = 1000;         ///< of a frontend that adds no points
constexpr double kMoved = 0.02;           ///< of the cloud's size: how far bundle adjustment may move a point
constexpr double kPlausibleFront = 0.5;   ///< of the points in front of the camera
constexpr double kClearlyBetter = 1.5;    ///< times as many points in the image
constexpr double kConvincingImage = 0.6;  ///< of the points in the image
constexpr double kHopelessImage = 0.4;

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
  if (configured.body_from_cam) {
    others.emplace_back("~pose_child: body, the inverse of T_body_cam",
                        PoseSemantics{configured.direction, Child::kBody, configured.body_from_cam->inverse()});
  }
  return others;
}

/// Median distance of the points from their median, which far outliers do not change.
double SizeOf(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d middle;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const Eigen::Vector3d& point : points) values.push_back(point[axis]);
    middle[axis] = Median(std::move(values));
  }
  std::vector<double> distances;
  for (const Eigen::Vector3d& point : points) distances.push_back((point - middle).norm());
  return Median(std::move(distances));
}

/// A number for each cell of space; those of cells far apart may be equal.
uint64_t CellOf(const Eigen::Vector3d& point, double cell, const Eigen::Vector3i& offset = Eigen::Vector3i::Zero()) {
  constexpr int kBits = 21;
  uint64_t number = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double at = std::floor(std::clamp(point[axis] / cell, -1e15, 1e15));
    const auto index = static_cast<uint64_t>(static_cast<int64_t>(at) + offset[axis]);
    number = number << kBits | (index & ((uint64_t{1} << kBits) - 1));
  }
  return number;
}

}  // namespace

std::optional<std::string> ConventionCheck::Add(const PoseSemantics& configured, const RigidTransform& cloud_received,
                                                const SparseCloud& cloud, bool cloud_in_camera,
                                                const PinholeCamera& camera) {
  if (decided_ || cloud.points.empty() || clouds_ >= kMostClouds) return std::nullopt;
  ++clouds_;
  const RigidTransform cam_from_world = WorldFromCamera(configured, cloud_received).inverse();
  const RigidTransform same = RigidTransform::Identity();
  const RigidTransform& as_configured = cloud_in_camera ? same : cam_from_world;
  const size_t step = 1 + cloud.points.size() / kSample;
  for (size_t i = 0; i < cloud.points.size(); i += step) {
    ++points_;
    in_front_ += (as_configured * cloud.points[i]).z() > 0;
  }
  const std::vector<Eigen::Vector3d> points = TakeNew(cloud);
  if (points.empty()) return std::nullopt;
  if (looks_.empty() || looks_.back() >= kNewPoints) looks_.push_back(0);
  looks_.back() += points.size();
  Count("as configured", as_configured, points, camera);
  Count(cloud_in_camera ? "~sparse_frame: world" : "~sparse_frame: camera", cloud_in_camera ? cam_from_world : same,
        points, camera);
  for (const auto& [name, semantics] : OtherSemantics(configured)) {
    Count((cloud_in_camera ? "~sparse_frame: world, " : "") + name,
          WorldFromCamera(semantics, cloud_received).inverse(), points, camera);
  }
  const auto looks = static_cast<int>(looks_.size());
  if (looks_.back() < kNewPoints || looks % kLooks != 0) return std::nullopt;
  const int times = looks / kLooks;
  if ((times & (times - 1)) != 0) return std::nullopt;  // not yet doubled
  auto warning = Judge(configured);
  decided_ = decided_ || looks >= kLastLooks;
  return warning;
}

std::vector<Eigen::Vector3d> ConventionCheck::TakeNew(const SparseCloud& cloud) {
  const auto is_new = [this](const Eigen::Vector3d& point) {
    for (int i = 0; i < 27; ++i) {
      if (before_.count(CellOf(point, cell_, {i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1})) > 0) return false;
    }
    return true;
  };
  std::vector<Eigen::Vector3d> points;
  const size_t step = 1 + cloud.points.size() / kSample;
  for (size_t i = 0; i < cloud.points.size() && !before_.empty(); i += step) {
    if (is_new(cloud.points[i])) points.push_back(cloud.points[i]);
  }
  cell_ = std::max(kMoved * SizeOf(cloud.points), std::numeric_limits<double>::min());
  before_.clear();
  for (const Eigen::Vector3d& point : cloud.points) before_.insert(CellOf(point, cell_));
  return points;
}

void ConventionCheck::Count(const std::string& name, const RigidTransform& cam_from_cloud,
                            const std::vector<Eigen::Vector3d>& points, const PinholeCamera& camera) {
  auto reading =
      std::find_if(readings_.begin(), readings_.end(), [&](const Reading& known) { return known.name == name; });
  if (reading == readings_.end()) reading = readings_.insert(readings_.end(), Reading{name, {}, {}});
  reading->in_front.resize(looks_.size());
  reading->in_image.resize(looks_.size());
  for (const Eigen::Vector3d& in_cloud : points) {
    const Eigen::Vector3d point = cam_from_cloud * in_cloud;
    if (!(point.z() > 0)) continue;
    ++reading->in_front.back();
    reading->in_image.back() += camera.Contains(camera.Project(point));
  }
}

double ConventionCheck::Recent(const std::vector<size_t>& counts) const {
  double sum = 0;
  for (size_t look = looks_.size() / 2; look < looks_.size(); ++look) {
    sum += static_cast<double>(counts[look]) / static_cast<double>(looks_[look]);
  }
  return sum / static_cast<double>(looks_.size() - looks_.size() / 2);
}

std::optional<std::string> ConventionCheck::Judge(const PoseSemantics& configured) {
  const Reading& now = readings_.front();
  const double now_image = Recent(now.in_image);
  std::vector<const Reading*> others;
  for (size_t i = 1; i < readings_.size(); ++i) others.push_back(&readings_[i]);
  std::sort(others.begin(), others.end(),
            [this](const Reading* a, const Reading* b) { return Recent(a->in_image) > Recent(b->in_image); });
  const double best_image = Recent(others.front()->in_image);
  // New points lie in the image with the right reading; some do so by chance with wrong ones.
  const bool fits = best_image > kConvincingImage && best_image > kClearlyBetter * now_image;
  const bool plausible = Recent(now.in_front) >= kPlausibleFront;
  const bool hopeless = !plausible && std::max(best_image, now_image) < kHopelessImage;
  if (!fits && !hopeless) return std::nullopt;
  const std::string found = Concat("of the last sparse points that were new ", Percent(Recent(now.in_front)),
                                   " % lie in front of the camera and only ", Percent(now_image),
                                   " % in the image (poses read as ", Describe(configured), ")");
  std::string fitting;
  size_t count = 0;
  for (const Reading* other : others) {
    if (count > 0 && Recent(other->in_image) * kClearlyBetter < best_image) break;
    fitting += Concat(count++ == 0 ? "" : "; ", other->name, ": ", Percent(Recent(other->in_image)), " % in the image");
  }
  decided_ = hopeless || count == 1;
  if (!decided_ && !warning_.empty()) return std::nullopt;  // that several fit has been told
  if (hopeless) {
    warning_ = Concat(
        found, "; no other reading fits (best: ", fitting,
        "): are they poses of the camera (those of an IMU or a robot need ~pose_child: body and T_body_cam), and "
        "the points in the poses' world (~sparse_frame)?");
  } else if (decided_) {
    warning_ = Concat(found, "; with ", fitting, ": set this");
  } else {
    warning_ = Concat(
        found, "; several other readings fit until the camera has moved on, and one of them is right: ", fitting);
  }
  return warning_;
}

std::optional<double> ConventionCheck::share_in_front() const {
  if (points_ == 0) return std::nullopt;
  return static_cast<double>(in_front_) / static_cast<double>(points_);
}

}  // namespace acmp
