#include "acmp_mapping/intake/reading_check.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <utility>

#include <Eigen/Dense>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using Direction = PoseSemantics::Direction;
using Child = PoseSemantics::Child;

constexpr size_t kMostGap = 3;  ///< images, of a pair
constexpr size_t kFewestMatches = 40, kFewestMatchesOfAll = 400;
constexpr size_t kFewestPairs = 12;          ///< of 6 images: of fewer, poses turn too little to tell readings apart
constexpr double kCertainShare = 0.8;        ///< of a listed reading; below, any rotation is tried as well ...
constexpr double kMoreOfAnyRotation = 1.15;  ///< ... which has parameters to fit, so it must have more by so much
constexpr double kClearlyMoreNear = 1.5;     ///< times as many
constexpr double kDegree = M_PI / 180;

/// Poses of the child, if they are of this direction.
std::pair<RigidTransform, RigidTransform> ChildPoses(const PoseSemantics& configured, const MatchedImages& pair,
                                                     Direction direction) {
  const RigidTransform child_from_cam = ChildFromCamera(configured);
  const RigidTransform one = pair.world_from_cam * child_from_cam.inverse();
  const RigidTransform other = (child_from_cam * pair.other_from_world).inverse();
  if (direction == configured.direction) return {one, other};
  return {one.inverse(), other.inverse()};
}

/// Calls function(distance) with the EpipolarDistance of matches.
/// @param step takes each step-th match
template <class Function>
void ForEachDistance(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs,
                     const PoseReading& reading, size_t step, const Function& function) {
  const RigidTransform child_from_cam = ChildFromCamera(reading.semantics);
  for (const MatchedImages& pair : pairs) {
    const auto [one, other] = ChildPoses(configured, pair, reading.semantics.direction);
    const RigidTransform other_from_one = (other * child_from_cam).inverse() * (one * child_from_cam);
    for (size_t i = 0; i < pair.rays.size(); i += step) {
      function(EpipolarDistance(other_from_one, pair.rays[i], pair.other_rays[i], pair.focal_length));
    }
  }
}

bool HasMore(const PoseReading& a, const PoseReading& b) { return a.share > b.share; }

void FindShare(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs, PoseReading* reading) {
  size_t near = 0, all = 0;
  ForEachDistance(configured, pairs, *reading, 1, [&](double distance) { ++all, near += distance < 1; });
  reading->share = static_cast<double>(near) / static_cast<double>(std::max<size_t>(1, all));
}

/// The first one is as configured.
std::vector<PoseReading> ReadingsOf(const PoseSemantics& configured) {
  std::vector<PoseReading> readings = {{"", configured}};
  for (const Direction direction : {Direction::kWorldFromCam, Direction::kCamFromWorld}) {
    const auto add = [&](const char* name, Child child, bool inverse) {
      PoseSemantics other = {direction, child, configured.body_from_cam};
      if (inverse) other.body_from_cam = other.body_from_cam->inverse();
      if (direction == configured.direction && child == configured.child && !inverse) return;
      readings.push_back({direction == configured.direction ? name : Concat(name, ", ~pose_is: ", Name(direction)),
                          other, 0, !inverse});
    };
    add("poses of the camera, ~pose_child: camera_optical", Child::kCameraOptical, false);
    add("poses of the camera, ~pose_child: camera_flu", Child::kCameraFlu, false);
    if (!configured.body_from_cam) continue;
    add(configured.child == Child::kBody ? "poses of the body, ~pose_child: body"
                                         : "poses of the body, ~pose_child: body, with the T_body_cam of tf",
        Child::kBody, false);
    add("the inverse of T_body_cam, ~pose_child: body", Child::kBody, true);
  }
  return readings;
}

/// Whether the child turns about two axes: else many rotations between it and the camera fit alike.
bool TurnsAboutTwoAxes(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs) {
  constexpr double kFewestDegrees = 2, kAxesApart = 0.3;  // sine
  std::vector<Eigen::Vector3d> axes;
  for (const MatchedImages& pair : pairs) {
    const auto [one, other] = ChildPoses(configured, pair, configured.direction);
    const Eigen::AngleAxisd turn(other.linear().transpose() * one.linear());
    if (turn.angle() >= kFewestDegrees * kDegree) axes.push_back(turn.axis());
  }
  return std::any_of(axes.begin(), axes.end(),
                     [&](const Eigen::Vector3d& axis) { return axis.cross(axes.front()).norm() >= kAxesApart; });
}

/// Sum of the squared distances from the lines, each at most `limit`.
double LossOf(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs, const PoseReading& reading,
              double limit, size_t step = 1) {
  double sum = 0;
  ForEachDistance(configured, pairs, reading, step,
                  [&](double distance) { sum += std::pow(std::min(distance, limit), 2); });
  return sum;
}

/// The rotation between child and camera that fits the matches best, the camera being at `place` in the child's frame.
/// Rotations all over are tried, then ever smaller changes of the best one.
PoseReading FitRotation(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs, Direction direction,
                        const Eigen::Vector3d& place) {
  constexpr double kCoarse = 7, kFine = 1.7, kDegreesOfOne = 1.5;
  constexpr int kRotations = 3000;       // one within 17 degrees of nearly any ...
  constexpr size_t kMatchesOfOne = 600;  // ... which some of the matches tell from others
  PoseReading best = {"", {direction, Child::kBody, RigidTransform(Eigen::Translation3d(place))}, 0, false};
  double loss = HUGE_VAL;
  const auto try_rotation = [&](const Eigen::Matrix3d& child_from_cam, double limit, size_t step = 1) {
    PoseReading reading = best;
    reading.semantics.body_from_cam->linear() = child_from_cam;
    const double found = LossOf(configured, pairs, reading, limit, step);
    if (found < loss) loss = found, best = reading;
  };
  std::minstd_rand random(1);
  const auto number = [&random] { return static_cast<double>(random() % 2001) / 1000 - 1; };
  size_t matches = 0;
  for (const MatchedImages& pair : pairs) matches += pair.rays.size();
  for (int i = 0; i < kRotations;) {
    const Eigen::Quaterniond rotation(number(), number(), number(), number());
    if (!(rotation.squaredNorm() > 0 && rotation.squaredNorm() < 1)) continue;  // those in the ball are evenly spread
    try_rotation(rotation.normalized().toRotationMatrix(), kCoarse, 1 + matches / kMatchesOfOne);
    ++i;
  }
  for (const double limit : {kCoarse, kFine}) {
    loss = LossOf(configured, pairs, best, limit);
    for (double step = kDegreesOfOne * limit * kDegree; step > 0.1 * kDegree; step *= 0.95) {
      const Eigen::Vector3d turn = step * Eigen::Vector3d(number(), number(), number());
      try_rotation(best.semantics.body_from_cam->linear() * Eigen::AngleAxisd(turn.norm(), turn.normalized()), limit);
    }
  }
  FindShare(configured, pairs, &best);
  return best;
}

/// The best of both directions; none where they fit alike, or badly, or nothing tells.
std::optional<PoseReading> FitRotations(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs) {
  if (!TurnsAboutTwoAxes(configured, pairs)) return std::nullopt;
  std::vector<Eigen::Vector3d> places = {Eigen::Vector3d::Zero()};
  if (configured.body_from_cam) places.emplace_back(configured.body_from_cam->translation());
  std::vector<PoseReading> best;  // of each direction
  for (const Direction direction : {Direction::kWorldFromCam, Direction::kCamFromWorld}) {
    best.push_back({"", configured, 0, false});
    for (const Eigen::Vector3d& place : places) {
      PoseReading reading = FitRotation(configured, pairs, direction, place);
      if (reading.share > best.back().share) best.back() = std::move(reading);
    }
  }
  std::sort(best.begin(), best.end(), HasMore);
  if (best.front().share < kClearlyMoreNear * best.back().share) return std::nullopt;
  std::string rotation;
  const Eigen::Matrix3d found = ChildFromCamera(best.front().semantics).linear();
  for (int i = 0; i < 9; ++i) {
    const double rounded = std::round(100 * found(i / 3, i % 3)) / 100;
    rotation += Concat(i == 0 ? "" : i % 3 == 0 ? "; " : " ", rounded + 0.0);
  }
  best.front().name = Concat("poses of a body, ~pose_child: body, ~pose_is: ", Name(best.front().semantics.direction),
                             ", and T_body_cam with a rotation of about [", rotation, "]");
  return best.front();
}

long PercentOf(double share) { return std::lround(100 * share); }

std::string DescribeVerdict(const PoseSemantics& configured, const ReadingVerdict& verdict) {
  if (verdict.fitting.empty()) return "";
  std::string fitting;
  for (const PoseReading& reading : verdict.fitting) {
    fitting += Concat(fitting.empty() ? "" : "; ", reading.name, " (", PercentOf(reading.share), " %)");
  }
  return Concat(
      "; poses read as ", Describe(configured), " put ", PercentOf(*verdict.share),
      " % of the matches between images where they should lie: ",
      verdict.fitting.size() == 1 ? "what fits is " : "several readings fit, and one of them is right: ", fitting);
}

}  // namespace

bool ReadingVerdict::FitsToo(PoseSemantics::Child child) const {
  return tried.empty() || std::any_of(tried.begin(), tried.end(), [&](const PoseReading& reading) {
           const PoseSemantics& meant = reading.semantics;
           return meant.child == child && reading.is_declared_by_name &&
                  reading.share * kClearlyMoreNear >= tried.front().share;
         });
}

ReadingVerdict JudgeReadings(const PoseSemantics& configured, const std::vector<MatchedImages>& pairs) {
  size_t matches = 0;
  for (const MatchedImages& pair : pairs) matches += pair.rays.size();
  if (pairs.size() < kFewestPairs || matches < kFewestMatchesOfAll) return {};
  std::vector<PoseReading> readings = ReadingsOf(configured);
  for (PoseReading& reading : readings) FindShare(configured, pairs, &reading);
  ReadingVerdict verdict;
  verdict.share = readings.front().share;
  const auto fits = [&](const PoseReading& reading) {
    return reading.share > ReadingVerdict::kFittingShare && reading.share > kClearlyMoreNear * *verdict.share;
  };
  std::sort(readings.begin(), readings.end(), HasMore);
  verdict.tried = std::move(readings);
  for (const PoseReading& reading : verdict.tried) {
    if (!fits(reading) || reading.share * kClearlyMoreNear < verdict.tried.front().share) break;
    verdict.fitting.push_back(reading);
  }
  if (verdict.tried.front().share < kCertainShare) {
    const auto found = FitRotations(configured, pairs);
    const bool better = found && found->share > kMoreOfAnyRotation * verdict.tried.front().share;
    if (better && fits(*found)) verdict.fitting = {*found};
  }
  verdict.text = DescribeVerdict(configured, verdict);
  return verdict;
}

void ReadingCheck::Add(const Frame& frame) {
  SmallImage image = MakeSmallImage(frame);
  if (image.gray.empty()) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  images_.push_back(std::move(image));
  if (images_.size() > kept_images_) images_.pop_front();
  ++added_;
}

void ReadingCheck::Clear() {
  const std::lock_guard<std::mutex> lock(mutex_);
  images_.clear();
  next_ = 0;
  verdict_ = {};
  ++cleared_;
}

ReadingVerdict ReadingCheck::Judge(const PoseSemantics& configured) {
  std::vector<SmallImage> images;
  uint64_t cleared = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (added_ < next_) return verdict_;
    next_ = added_ + images_.size();
    images.assign(images_.begin(), images_.end());
    cleared = cleared_;
  }
  ReadingVerdict verdict = JudgeReadings(configured, Match(images));
  const std::lock_guard<std::mutex> lock(mutex_);
  if (cleared == cleared_) verdict_ = std::move(verdict);
  return verdict_;
}

ReadingVerdict ReadingCheck::verdict() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return verdict_;
}

std::vector<MatchedImages> ReadingCheck::Match(const std::vector<SmallImage>& small_images) {
  std::vector<FeatureImage> images;
  std::vector<MatchedImages> pairs;
  for (const SmallImage& image : small_images) {
    images.push_back(FindFeatures(image));
    const FeatureImage& other = images.back();
    for (size_t i = images.size() - 1, j = i < kMostGap ? 0 : i - kMostGap; j < i; ++j) {
      const FeatureImage& one = images[j];
      constexpr double kSamePlace = 1e-9;  // of a camera that stands matches say nothing
      if ((other.cam_from_world * one.cam_from_world.inverse()).translation().norm() < kSamePlace) continue;
      MatchedImages pair = {{}, {}, one.cam_from_world.inverse(), other.cam_from_world, other.camera.fx};
      for (const FeatureMatch& match : MatchFeatures(one, other)) {
        pair.rays.emplace_back(one.camera.Unproject(one.pixels[match.one], 1));
        pair.other_rays.emplace_back(other.camera.Unproject(other.pixels[match.other], 1));
      }
      if (pair.rays.size() >= kFewestMatches) pairs.push_back(std::move(pair));
    }
  }
  return pairs;
}

}  // namespace acmp
