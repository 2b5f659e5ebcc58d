#include "acmp_mapping/keyframe/source_view_selection.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"

namespace acmp {
namespace {

constexpr size_t kGridCells = 8;  // per axis; 16 x 12 choose no better
constexpr size_t kMaxLandmarks = 512;

using PerPoint = Eigen::ArrayXd;

Eigen::Vector3d CentreInWorld(const PosedCamera& view) { return view.cam_from_world.inverse().translation(); }

double MeanFocalLength(const PinholeCamera& camera) { return 0.5 * (camera.fx + camera.fy); }

/// 1 while the two images show a surface at about the same resolution; windows of very different scale do not
/// correlate.
double ScaleWeight(double px_per_unit_ratio) {
  constexpr double kFreeRatio = 1.5;
  const double ratio = std::max(px_per_unit_ratio, 1 / px_per_unit_ratio);
  return ratio <= kFreeRatio ? 1.0 : (kFreeRatio / ratio) * (kFreeRatio / ratio);
}

/// 0 at the least angle, rising to 1 over the best angles, then falling like a Gaussian: wide baselines still match,
/// but foreshortening and occlusion grow. Best angles of 3 to 8 or 8 to 14 degrees choose about as well.
double AngleWeight(double angle_deg) {
  constexpr double kBestMinDeg = 5.0, kBestMaxDeg = 10.0;
  if (angle_deg < kBestMinDeg) {
    return std::max(0.0, (angle_deg - kMinSourceAngleDeg) / (kBestMinDeg - kMinSourceAngleDeg));
  }
  const double excess = std::max(0.0, angle_deg - kBestMaxDeg) / kBestMaxDeg;
  return std::exp(-0.5 * excess * excess);
}

/// Points that the reference is taken to see.
class ReferencePoints {
 public:
  /// On a grid of pixels, all at the typical depth.
  ReferencePoints(const PosedCamera& view, double typical_depth) : ReferencePoints(view) {
    const RigidTransform world_from_cam = view.cam_from_world.inverse();
    for (size_t i = 0; i < kGridCells * kGridCells; ++i) {
      const Eigen::Vector2d pixel((static_cast<double>(i % kGridCells) + 0.5) / kGridCells * view.camera.width - 0.5,
                                  (static_cast<double>(i / kGridCells) + 0.5) / kGridCells * view.camera.height - 0.5);
      Add(world_from_cam * view.camera.Unproject(pixel, typical_depth));
      all_.push_back(i);
    }
    for (const Eigen::Vector3d& point : points_) middle_ += point / static_cast<double>(points_.size());
    for (const Eigen::Vector3d& point : points_) radius_ = std::max(radius_, 1.001 * (point - middle_).norm());
  }

  ReferencePoints(const PosedCamera& view, const std::vector<ObservedLandmark>& landmarks) : ReferencePoints(view) {
    const size_t count = std::min(landmarks.size(), kMaxLandmarks);
    for (size_t i = 0; i < count; ++i) {  // evenly among all
      const ObservedLandmark& landmark = landmarks[i * landmarks.size() / count];
      for (size_t other : landmark.others) observed_[other].push_back(i);
      Add(landmark.in_world);
    }
  }

  /// The points that a candidate may see, where they lie in its view: of landmarks those that it observes, of a grid
  /// all, or none where it looks elsewhere.
  const std::vector<size_t>& MaySee(size_t candidate, const PosedCamera& view) const {
    static const std::vector<size_t> none;
    if (!all_.empty()) return MaySeeAny(view) ? all_ : none;
    const auto found = observed_.find(candidate);
    return found == observed_.end() ? none : found->second;
  }

  const Eigen::Vector3d& operator[](size_t i) const { return points_[i]; }
  size_t size() const { return points_.size(); }
  double DepthOf(size_t i) const { return (view_.cam_from_world * points_[i]).z(); }
  double nearest() const { return nearest_; }                ///< depth of theirs
  const Eigen::Vector3d& centre() const { return centre_; }  ///< of the reference, in the world
  double focal_length() const { return MeanFocalLength(view_.camera); }

 private:
  explicit ReferencePoints(const PosedCamera& view) : view_(view), centre_(CentreInWorld(view)) {}

  void Add(const Eigen::Vector3d& in_world) {
    points_.push_back(in_world);
    nearest_ = std::min(nearest_, DepthOf(points_.size() - 1));
  }

  /// False where the sphere about the points lies beyond one side of what a view sees: much faster than to look at the
  /// points, for the many views that are far away.
  bool MaySeeAny(const PosedCamera& view) const {
    const PinholeCamera& camera = view.camera;
    const Eigen::Vector3d middle = view.cam_from_world * middle_;
    const auto is_within = [&](double across, double focal_length, double border) {
      return across * focal_length + middle.z() * border >= -radius_ * std::hypot(focal_length, border);
    };
    return is_within(middle.x(), camera.fx, camera.cx + 0.5) && is_within(middle.y(), camera.fy, camera.cy + 0.5) &&
           is_within(-middle.x(), camera.fx, camera.width - 0.5 - camera.cx) &&
           is_within(-middle.y(), camera.fy, camera.height - 0.5 - camera.cy);
  }

  PosedCamera view_;
  Eigen::Vector3d centre_;
  std::vector<Eigen::Vector3d> points_;  ///< in the world
  double nearest_ = std::numeric_limits<double>::infinity();
  std::unordered_map<size_t, std::vector<size_t>> observed_;  ///< of landmarks: those that a candidate observes
  std::vector<size_t> all_;                                   ///< of a grid
  Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();          ///< of a sphere that has all points of a grid in it
  double radius_ = 0;                                         ///< its
};

/// Triangulation angle at a point, deg.
double AngleDeg(const Eigen::Vector3d& to_reference, const Eigen::Vector3d& to_view) {
  // From the cross product it keeps its precision where small ones decide whether there is a baseline.
  return std::atan2(to_reference.cross(to_view).norm(), to_reference.dot(to_view)) / kRadPerDeg<double>;
}

/// A candidate that is useful.
struct UsefulView {
  size_t index = 0;
  int priority = 0;
  Eigen::Vector3d direction;  ///< of its baseline
  PerPoint weights;           ///< at the reference's points
  PerPoint seen;  ///< sums of the chosen views' weights there, each times the cosine between the baselines' directions
  double gain = 0;
  bool is_chosen = false;

  void Count(const UsefulView& chosen) {
    seen += std::max(0.0, direction.dot(chosen.direction)) * chosen.weights;
    gain = (weights / (1 + seen)).mean();
  }
  bool IsBetterThan(const UsefulView& other) const {
    return priority != other.priority ? priority > other.priority : gain > other.gain;
  }
};

/// The candidate's centre lies elsewhere. Rounding of the poses alone leaves below 1e-12 of the distance to the world's
/// origin; the matcher refuses less than a millionth of the nearest depth.
bool HasBaseline(const ReferencePoints& points, const Eigen::Vector3d& centre) {
  const double baseline = (centre - points.centre()).norm();
  return baseline > 1e-12 * points.centre().norm() && baseline > 1e-6 * points.nearest();
}

/// The candidate if it is useful; counts it in `selection`.
std::optional<UsefulView> Assess(const ReferencePoints& points, const SourceViewCandidate& candidate, size_t index,
                                 SourceViewSelection* selection) {
  const PosedCamera& view = candidate.view;
  const Eigen::Vector3d centre = CentreInWorld(view);
  if (!HasBaseline(points, centre)) {
    ++selection->num_without_baseline;
    return std::nullopt;
  }
  const double least = kMinSourceOverlap * static_cast<double>(points.size());
  const double focal_ratio = MeanFocalLength(view.camera) / points.focal_length();
  std::vector<double> angles_deg;  // of what it sees
  std::vector<std::pair<size_t, double>> weights;
  for (size_t i : points.MaySee(index, view)) {
    const Eigen::Vector3d in_cam = view.cam_from_world * points[i];
    if (!(in_cam.z() > 0) || !view.camera.Contains(view.camera.Project(in_cam))) continue;
    const double angle_deg = AngleDeg(points.centre() - points[i], centre - points[i]);
    angles_deg.push_back(angle_deg);
    if (angle_deg < kMinSourceAngleDeg) continue;
    weights.emplace_back(i, AngleWeight(angle_deg) * ScaleWeight(focal_ratio * points.DepthOf(i) / in_cam.z()));
  }
  if (static_cast<double>(angles_deg.size()) < least) {
    ++selection->num_without_overlap;
    return std::nullopt;
  }
  UsefulView useful = {index, candidate.priority, (centre - points.centre()).normalized(), {}, {}};
  useful.weights = useful.seen = PerPoint::Zero(static_cast<Eigen::Index>(points.size()));
  for (const auto& [i, weight] : weights) useful.weights[static_cast<Eigen::Index>(i)] = weight;
  // Not the median: a camera that moves ahead sees near things under wide angles and most of the scene under none.
  if (static_cast<double>(weights.size()) < least || useful.weights.maxCoeff() <= 0) {
    ++selection->num_with_small_angle;
    selection->largest_small_angle_deg = std::max(selection->largest_small_angle_deg, Median(std::move(angles_deg)));
    return std::nullopt;
  }
  ++selection->num_useful;
  useful.gain = useful.weights.mean();
  return useful;
}

SourceViewSelection Choose(const ReferencePoints& points, const std::vector<SourceViewCandidate>& candidates,
                           size_t max_source_views) {
  SourceViewSelection selection;
  std::vector<UsefulView> useful;
  for (size_t i = 0; i < candidates.size(); ++i) {
    if (auto view = Assess(points, candidates[i], i, &selection)) useful.push_back(std::move(*view));
  }
  const size_t wanted = std::min(useful.size(), max_source_views);
  while (selection.views.size() < wanted) {
    UsefulView* best = nullptr;
    for (UsefulView& view : useful) {
      if (!view.is_chosen && (best == nullptr || view.IsBetterThan(*best))) best = &view;
    }
    best->is_chosen = true;
    selection.views.push_back({best->index, best->gain});
    selection.gain += best->gain;
    for (UsefulView& view : useful) view.Count(*best);
  }
  return selection;
}

}  // namespace

double TypicalDepth(const DepthRange& range) { return std::sqrt(static_cast<double>(range.min) * range.max); }

SourceViewSelection SelectSourceViews(const PosedCamera& reference, double typical_depth,
                                      const std::vector<ObservedLandmark>& landmarks,
                                      const std::vector<SourceViewCandidate>& candidates, int max_source_views) {
  CheckRange("max_source_views", max_source_views, 1, kMaxSelectedViews);
  if (!(typical_depth > 0) || !std::isfinite(typical_depth)) {
    throw InvalidInputError(
        Concat("choice of source views: typical_depth = ", typical_depth, ": must be positive and finite"));
  }
  const auto most = static_cast<size_t>(max_source_views);
  if (landmarks.size() >= kMinDepthLandmarks) {
    constexpr size_t kEnough = 4;  // on recorded scenes four such views are better than four and more that share none
    SourceViewSelection by_landmarks = Choose({reference, landmarks}, candidates, most);
    if (by_landmarks.views.size() >= std::min(kEnough, most)) return by_landmarks;
  }
  return Choose({reference, typical_depth}, candidates, most);
}

}  // namespace acmp
