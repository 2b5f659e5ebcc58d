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

long Percent(double share) { return std::lround(100 * share); }

/// Median distance of the points from their median, which far outliers do not change.
double SizeOf(const std::vector<Eigen::Vector3d>& points) {
  std::vector<double> values(points.size());
  const auto median_of = [&](const auto& value) {
    std::transform(points.begin(), points.end(), values.begin(), value);
    return Median(values);
  };
  Eigen::Vector3d middle;
  for (int axis = 0; axis < 3; ++axis) {
    middle[axis] = median_of([axis](const Eigen::Vector3d& point) { return point[axis]; });
  }
  return median_of([&middle](const Eigen::Vector3d& point) { return (point - middle).norm(); });
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
  const double counted = std::min(kOfACloud, static_cast<double>(points.size()));
  const double weight = counted / static_cast<double>(points.size());
  recent_.points += counted;
  new_points_ += counted;
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d in_camera = as_configured * point;
    const Eigen::Vector3d otherwise = (cloud_in_camera ? cam_from_world : same) * point;
    recent_.in_front += in_camera.z() > 0 ? weight : 0;
    recent_.in_image += in_camera.z() > 0 && camera.Contains(camera.Project(in_camera)) ? weight : 0;
    recent_.in_image_otherwise += otherwise.z() > 0 && camera.Contains(camera.Project(otherwise)) ? weight : 0;
  }
  if (new_points_ < next_points_) return std::nullopt;
  std::optional<std::string> warning;
  if (new_points_ >= kFirstPoints) warning = Judge(configured, cloud_in_camera);
  next_points_ = std::max(kFirstPoints, 2 * new_points_);
  recent_ = {};
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

std::optional<std::string> ConventionCheck::Judge(const PoseSemantics& configured, bool cloud_in_camera) {
  const double in_front = recent_.in_front / recent_.points, in_image = recent_.in_image / recent_.points;
  const double otherwise = recent_.in_image_otherwise / recent_.points;
  // New points lie in the image with the right reading; some do so by chance with a wrong one.
  const bool fits = otherwise > kConvincingImage && otherwise > kClearlyBetter * in_image;
  const bool hopeless = in_front < kPlausibleFront && std::max(otherwise, in_image) < kHopelessImage;
  decided_ = fits || hopeless || new_points_ >= kLastPoints;
  if (!fits && !hopeless) return std::nullopt;
  const std::string other = Concat("~sparse_frame: ", cloud_in_camera ? "world" : "camera");
  warning_ = Concat("of the last sparse points that were new ", Percent(in_front),
                    " % lie in front of the camera and only ", Percent(in_image), " % in the image (poses read as ",
                    Describe(configured), "); with ", other, ": ", Percent(otherwise), " % in the image");
  warning_ += fits ? ": set this, unless the poses do not fit the images (~pose_is, ~pose_child, T_body_cam)"
                   : ": do ~pose_is and ~pose_child say what the poses are (those of an IMU or a robot need "
                     "~pose_child: body and T_body_cam), and are the points in the poses' world (~sparse_frame)?";
  return warning_;
}

std::optional<double> ConventionCheck::share_in_front() const {
  if (points_ == 0) return std::nullopt;
  return static_cast<double>(in_front_) / static_cast<double>(points_);
}

}  // namespace acmp
