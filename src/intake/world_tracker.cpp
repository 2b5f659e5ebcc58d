#include "acmp_mapping/intake/world_tracker.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {
namespace {

constexpr double kSameDepth = 0.05;  ///< relative
constexpr size_t kEnough = 20;       ///< landmarks that tell something
constexpr double kSameWorld = 0.5;   ///< of the landmarks that can be compared
constexpr double kSettled = 0.75;    ///< the same, while the world starts
constexpr int kEnoughAdjustments = 2;
constexpr int kMaxWaiting = 30;
constexpr double kFasterThanBefore = 5;
constexpr size_t kSpeeds = 10;

/// Landmarks by the direction in which a camera sees them.
class DirectionGrid {
 public:
  DirectionGrid(const std::vector<Eigen::Vector3d>& landmarks_in_world, const PinholeCamera& camera,
                const RigidTransform& cam_from_world)
      : camera_(camera), cam_from_world_(cam_from_world), cells_(kCells * kCells) {
    for (const Eigen::Vector3d& point :
         FindLandmarksInView(landmarks_in_world, camera, cam_from_world).points_in_world) {
      const auto [col, row, depth] = Locate(point);
      cells_[static_cast<size_t>(row * kCells + col)].push_back(depth);
    }
  }

  /// Whether something is near in direction, and then whether it has this point's depth. The point is in view.
  std::optional<bool> HasDepthOf(const Eigen::Vector3d& point_in_world) const {
    const auto [col, row, depth] = Locate(point_in_world);
    std::optional<bool> found;
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, kCells - 1); ++r) {
      for (int c = std::max(col - 1, 0); c <= std::min(col + 1, kCells - 1); ++c) {
        for (const double other : cells_[static_cast<size_t>(r * kCells + c)]) {
          found = found.value_or(false) || std::abs(other - depth) <= kSameDepth * depth;
        }
      }
    }
    return found;
  }

 private:
  static constexpr int kCells = 32;  ///< per axis

  std::tuple<int, int, double> Locate(const Eigen::Vector3d& point_in_world) const {
    const Eigen::Vector3d point = cam_from_world_ * point_in_world;
    const Eigen::Vector2d pixel = camera_.Project(point);
    const auto cell = [](double position, int size) {
      return std::clamp(static_cast<int>((position + 0.5) / size * kCells), 0, kCells - 1);
    };
    return {cell(pixel.x(), camera_.width), cell(pixel.y(), camera_.height), point.z()};
  }

  PinholeCamera camera_;
  RigidTransform cam_from_world_;
  std::vector<std::vector<double>> cells_;  ///< depths
};

/// What has become of the landmarks of one image, seen from another one.
struct Comparison {
  size_t in_view = 0;    ///< of the new camera
  size_t compared = 0;   ///< of these, those that something lies in the direction of
  size_t stayed = 0;     ///< of these, those whose depth it has
  size_t identical = 0;  ///< of all, those that are named again with the same numbers

  double share_that_stayed() const { return static_cast<double>(stayed) / static_cast<double>(compared); }
};

Comparison Compare(const std::vector<Eigen::Vector3d>& before, const WorldTracker::Sample& now) {
  constexpr size_t kSample = 1000;  // of what may be a whole map
  const auto less = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return std::tie(a.x(), a.y(), a.z()) < std::tie(b.x(), b.y(), b.z());
  };
  std::vector<Eigen::Vector3d> sorted = now.landmarks_in_world;
  std::sort(sorted.begin(), sorted.end(), less);
  const RigidTransform cam_from_world = now.world_from_cam.inverse();
  const DirectionGrid grid(now.landmarks_in_world, now.camera, cam_from_world);
  const std::vector<Eigen::Vector3d> in_view = FindLandmarksInView(before, now.camera, cam_from_world).points_in_world;
  Comparison comparison;
  comparison.in_view = in_view.size();
  for (size_t i = 0; i < in_view.size(); i += 1 + in_view.size() / kSample) {
    const bool identical = std::binary_search(sorted.begin(), sorted.end(), in_view[i], less);
    const std::optional<bool> has_depth = identical ? true : grid.HasDepthOf(in_view[i]);
    comparison.identical += identical;
    comparison.compared += has_depth.has_value();
    comparison.stayed += has_depth.value_or(false);
  }
  return comparison;
}

size_t NumInView(const std::vector<Eigen::Vector3d>& landmarks, const WorldTracker::Sample& sample) {
  return FindLandmarksInView(landmarks, sample.camera, sample.world_from_cam.inverse()).points_in_world.size();
}

}  // namespace

WorldTracker::Judgement WorldTracker::Add(Sample sample) {
  Judgement judgement = Continue(sample);
  if (last_stamp_ns_ && sample.stamp_ns > *last_stamp_ns_) {
    const double elapsed_s = static_cast<double>(sample.stamp_ns - *last_stamp_ns_) * 1e-9;
    speeds_.push_back((sample.world_from_cam.translation() - last_position_).norm() / elapsed_s);
    if (speeds_.size() > kSpeeds) speeds_.pop_front();
  }
  last_stamp_ns_ = sample.stamp_ns;
  last_position_ = sample.world_from_cam.translation();
  if (judgement.verdict == Verdict::kNewWorld) speeds_.clear();
  if (!sample.landmarks_in_world.empty()) last_ = std::move(sample);
  return judgement;
}

WorldTracker::Judgement WorldTracker::Continue(const Sample& sample) {
  if (sample.landmarks_in_world.empty()) {
    if (!last_ && sample.has_empty_cloud) return ContinueWithoutLandmarks(sample.world_from_cam);
    if (HasJumped(sample)) return Change("the camera has jumped, by more than the scene's depth");
    return is_starting_ && last_ ? ContinueStart(1, false) : Judgement{};
  }
  if (!last_) return is_starting_ ? ContinueStart(1, false) : Judgement{};

  const Comparison comparison = Compare(last_->landmarks_in_world, sample);
  if (comparison.compared < kEnough) {
    const bool both_have_some = NumInView(last_->landmarks_in_world, *last_) >= kEnough &&
                                NumInView(sample.landmarks_in_world, sample) >= kEnough;
    const bool share_none = comparison.in_view == 0 && NumInView(sample.landmarks_in_world, *last_) == 0;
    if (both_have_some && share_none) return Change("none of the last image's landmarks is in view of this one");
    return is_starting_ ? ContinueStart(1, false) : Judgement{};
  }
  const double stayed = comparison.share_that_stayed();
  if (!is_starting_ && stayed < kSameWorld) {
    return Change(Concat("of ", comparison.compared, " landmarks only ", std::lround(100 * stayed),
                         " % are where the last image had them"));
  }
  return is_starting_ ? ContinueStart(stayed, 2 * comparison.identical < comparison.compared) : Judgement{};
}

WorldTracker::Judgement WorldTracker::ContinueWithoutLandmarks(const RigidTransform& world_from_cam) {
  const std::optional<RigidTransform> before = std::exchange(last_without_, world_from_cam);
  if (!before) return {Verdict::kWait, ""};
  if (before->matrix() == world_from_cam.matrix()) is_starting_ = true;
  if (!is_starting_) return {};
  return {Verdict::kNotInitialised, "the frontend has no usable point yet, and sends the same pose again and again"};
}

WorldTracker::Judgement WorldTracker::ContinueStart(double share_that_stayed, bool were_adjusted) {
  ++waiting_;
  if (share_that_stayed < kSettled) {
    adjustments_ = 0;
    waiting_ = 1;
    return {Verdict::kNotSettled, Concat("the frontend's world still settles: ", std::lround(100 * share_that_stayed),
                                         " % of its landmarks stayed where they were")};
  }
  adjustments_ += were_adjusted;
  if (adjustments_ < kEnoughAdjustments && waiting_ < kMaxWaiting) return {Verdict::kWait, ""};
  is_starting_ = false;
  return {};
}

WorldTracker::Judgement WorldTracker::Change(const std::string& reason) {
  const bool was_starting = is_starting_;
  is_starting_ = true;
  adjustments_ = 0;
  waiting_ = 1;
  return {was_starting ? Verdict::kNotSettled : Verdict::kNewWorld, reason};
}

bool WorldTracker::HasJumped(const Sample& sample) const {
  if (!last_stamp_ns_ || speeds_.size() < kSpeeds || sample.scene_depth <= 0) return false;
  if (sample.stamp_ns <= *last_stamp_ns_) return false;
  const double step = (sample.world_from_cam.translation() - last_position_).norm();
  const double elapsed_s = static_cast<double>(sample.stamp_ns - *last_stamp_ns_) * 1e-9;
  return step > sample.scene_depth &&
         step / elapsed_s > kFasterThanBefore * *std::max_element(speeds_.begin(), speeds_.end());
}

}  // namespace acmp
