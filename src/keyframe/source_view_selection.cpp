#include "acmp_mapping/keyframe/source_view_selection.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"

namespace acmp {
namespace {

constexpr int kGridCells = 8;  // per axis; 16 x 12 choose no better
constexpr int kGridPoints = kGridCells * kGridCells;

using PerPoint = Eigen::Array<double, kGridPoints, 1>;
using GridPoints = Eigen::Array<double, kGridPoints, 3>;  ///< x, y, z

Eigen::Vector3d CentreInWorld(const PosedCamera& view) { return view.cam_from_world.inverse().translation(); }

double MeanFocalLength(const PinholeCamera& camera) { return 0.5 * (camera.fx + camera.fy); }

/// 1 while the two images show a surface at about the same resolution; windows of very different scale do not
/// correlate.
double ScaleWeight(double px_per_unit_ratio) {
  constexpr double kFreeRatio = 1.5;
  const double ratio = std::max(px_per_unit_ratio, 1 / px_per_unit_ratio);
  return ratio <= kFreeRatio ? 1.0 : (kFreeRatio / ratio) * (kFreeRatio / ratio);
}

GridPoints TowardsCentre(const GridPoints& points, const Eigen::Vector3d& centre) {
  return centre.transpose().array().replicate<kGridPoints, 1>() - points;
}

/// Depths of planes that divide the range into equal ratios, of at least kPlaneRatio where it is wider than that.
std::vector<double> PlanesOf(const DepthRange& range) {
  constexpr double kPlaneRatio = 5;  // rooms have one plane, streets two or three
  const double log_ratio = std::log(static_cast<double>(range.max) / range.min);
  const int count = std::max(1, static_cast<int>(log_ratio / std::log(kPlaneRatio)));
  std::vector<double> depths;
  for (int i = 0; i < count; ++i) depths.push_back(range.min * std::exp((i + 0.5) / count * log_ratio));
  return depths;
}

/// What the reference sees, were everything on these planes in turn.
struct Reference {
  Reference(const PosedCamera& view, const std::vector<double>& planes)
      : centre(CentreInWorld(view)), focal_length(MeanFocalLength(view.camera)), least_depth(planes.front()) {
    const RigidTransform world_from_cam = view.cam_from_world.inverse();
    for (int row = 0; row < kGridCells; ++row) {
      for (int col = 0; col < kGridCells; ++col) {
        const Eigen::Vector2d pixel((col + 0.5) / kGridCells * view.camera.width - 0.5,
                                    (row + 0.5) / kGridCells * view.camera.height - 0.5);
        const int i = row * kGridCells + col;
        depths[i] = planes[static_cast<size_t>(row + col) % planes.size()];
        points.row(i) = (world_from_cam * view.camera.Unproject(pixel, depths[i])).array();
      }
    }
    to_centre = TowardsCentre(points, centre);
    middle = points.colwise().mean().transpose();
    radius = 1.001 * std::sqrt(TowardsCentre(points, middle).square().rowwise().sum().maxCoeff());
  }

  GridPoints points;       ///< in the world
  GridPoints to_centre;    ///< from them
  PerPoint depths;         ///< of them
  Eigen::Vector3d centre;  ///< of the camera, in the world
  double focal_length;     ///< px
  double least_depth;      ///< of the points
  Eigen::Vector3d middle;  ///< of a sphere that has all points in it
  double radius;           ///< its
};

/// False where the sphere about the reference's points lies beyond one side of what a view sees: much faster than to
/// look at the points, for the many views that are far away.
bool MaySeeAny(const Reference& reference, const PosedCamera& view) {
  const PinholeCamera& camera = view.camera;
  const Eigen::Vector3d middle = view.cam_from_world * reference.middle;
  const auto is_within = [&](double across, double focal_length, double border) {
    return across * focal_length + middle.z() * border >= -reference.radius * std::hypot(focal_length, border);
  };
  return is_within(middle.x(), camera.fx, camera.cx + 0.5) && is_within(middle.y(), camera.fy, camera.cy + 0.5) &&
         is_within(-middle.x(), camera.fx, camera.width - 0.5 - camera.cx) &&
         is_within(-middle.y(), camera.fy, camera.height - 0.5 - camera.cy);
}

/// Depths of the points in a view; 0 where it does not see them (DepthInView).
PerPoint DepthsInView(const GridPoints& points, const PosedCamera& view) {
  const Eigen::Matrix3d rotation = view.cam_from_world.linear();
  const Eigen::Vector3d translation = view.cam_from_world.translation();
  const auto in_cam = [&](int axis) -> PerPoint {
    return points.col(0) * rotation(axis, 0) + points.col(1) * rotation(axis, 1) + points.col(2) * rotation(axis, 2) +
           translation[axis];
  };
  const PinholeCamera& camera = view.camera;
  const PerPoint z = in_cam(2);
  const PerPoint u = camera.fx * in_cam(0) / z + camera.cx, v = camera.fy * in_cam(1) / z + camera.cy;
  return (z > 0 && u >= -0.5 && v >= -0.5 && u < camera.width - 0.5 && v < camera.height - 0.5).select(z, 0.0);
}

/// Triangulation angles at the points, by their tangents: most weights need no more.
struct Angles {
  Angles(const GridPoints& to_reference, const GridPoints& points, const Eigen::Vector3d& centre) {
    const GridPoints to_view = TowardsCentre(points, centre);
    const auto product = [&](int i, int j) -> PerPoint {
      return to_reference.col(i) * to_view.col(j) - to_reference.col(j) * to_view.col(i);
    };
    // From the cross product they keep their precision where small ones decide whether there is a baseline.
    sine = (product(1, 2).square() + product(2, 0).square() + product(0, 1).square()).sqrt();
    cosine = (to_reference * to_view).rowwise().sum();
  }

  double Deg(int i) const { return std::atan2(sine[i], cosine[i]) / kRadPerDeg<double>; }
  bool IsAtLeast(int i, double tangent) const { return cosine[i] <= 0 || sine[i] >= tangent * cosine[i]; }

  PerPoint sine, cosine;  ///< times the same positive number
};

/// 0 at the least angle, rising to 1 over the best angles, then falling like a Gaussian: wide baselines still match,
/// but foreshortening and occlusion grow. Best angles of 3 to 8 or 8 to 14 degrees choose about as well.
double AngleWeight(const Angles& angles, int i) {
  constexpr double kBestMinDeg = 5.0, kBestMaxDeg = 10.0;
  static const double best_min_tangent = std::tan(kBestMinDeg * kRadPerDeg<double>);
  static const double best_max_tangent = std::tan(kBestMaxDeg * kRadPerDeg<double>);
  if (angles.IsAtLeast(i, best_min_tangent) && !angles.IsAtLeast(i, best_max_tangent)) return 1;
  const double angle_deg = angles.Deg(i);
  if (angle_deg < kBestMinDeg) {
    return std::max(0.0, (angle_deg - kMinSourceAngleDeg) / (kBestMinDeg - kMinSourceAngleDeg));
  }
  const double excess = std::max(0.0, angle_deg - kBestMaxDeg) / kBestMaxDeg;
  return std::exp(-0.5 * excess * excess);
}

/// How much two baselines show the same: 1 where they are equal, 0 where one is much shorter or they are at right
/// angles.
double Likeness(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::max(0.0, a.dot(b)) / std::max(a.squaredNorm(), b.squaredNorm());
}

/// A candidate that is useful.
struct UsefulView {
  size_t index = 0;
  int priority = 0;
  Eigen::Vector3d baseline;             ///< from the reference's centre
  bool shares_landmarks = true;         ///< enough of them with the reference
  PerPoint weights = PerPoint::Zero();  ///< at the reference's points
  PerPoint seen = PerPoint::Zero();  ///< sums of the chosen views' weights there, each times Likeness of the baselines
  double gain = 0;
  bool is_chosen = false;

  void Count(const UsefulView& chosen) {
    seen += Likeness(baseline, chosen.baseline) * chosen.weights;
    gain = (weights / (1 + seen)).mean();
  }
  bool IsBetterThan(const UsefulView& other) const {
    return priority != other.priority ? priority > other.priority : gain > other.gain;
  }
};

/// The candidate's centre lies elsewhere. Rounding of the poses alone leaves below 1e-12 of the distance to the world's
/// origin; the matcher refuses less than a millionth of the nearest depth.
bool HasBaseline(const Reference& reference, const Eigen::Vector3d& centre) {
  const double baseline = (centre - reference.centre).norm();
  return baseline > 1e-12 * reference.centre.norm() && baseline > 1e-6 * reference.least_depth;
}

/// The candidate if it is useful; counts it in `selection`.
std::optional<UsefulView> Assess(const Reference& reference, const SourceViewCandidate& candidate, size_t index,
                                 SourceViewSelection* selection) {
  const PosedCamera& view = candidate.view;
  const Eigen::Vector3d centre = CentreInWorld(view);
  if (!HasBaseline(reference, centre)) {
    ++selection->num_without_baseline;
    return std::nullopt;
  }
  const PerPoint depths = MaySeeAny(reference, view) ? DepthsInView(reference.points, view) : PerPoint::Zero().eval();
  const auto num_seen = (depths > 0).count();
  constexpr double kLeastPoints = kMinSourceOverlap * kGridPoints;
  if (static_cast<double>(num_seen) < kLeastPoints) {
    ++selection->num_without_overlap;
    return std::nullopt;
  }
  UsefulView useful = {index, candidate.priority, centre - reference.centre,
                       candidate.shared_landmarks >= kMinSharedLandmarks};
  const double focal_ratio = MeanFocalLength(view.camera) / reference.focal_length;
  const Angles angles(reference.to_centre, reference.points, centre);
  const double least_tangent = std::tan(kMinSourceAngleDeg * kRadPerDeg<double>);
  int num_wide = 0;
  for (int i = 0; i < kGridPoints; ++i) {
    if (depths[i] <= 0 || !angles.IsAtLeast(i, least_tangent)) continue;
    ++num_wide;
    useful.weights[i] = AngleWeight(angles, i) * ScaleWeight(focal_ratio * reference.depths[i] / depths[i]);
  }
  // Not the median: a camera that moves ahead sees near things under wide angles and most of the scene under none.
  if (num_wide < kLeastPoints || useful.weights.maxCoeff() <= 0) {
    ++selection->num_with_small_angle;
    std::vector<double> angles_deg;
    for (int i = 0; i < kGridPoints; ++i) {
      if (depths[i] > 0) angles_deg.push_back(angles.Deg(i));
    }
    selection->largest_small_angle_deg = std::max(selection->largest_small_angle_deg, Median(std::move(angles_deg)));
    return std::nullopt;
  }
  ++selection->num_useful;
  useful.gain = useful.weights.mean();
  return useful;
}

/// Drops the views that hardly share landmarks with the reference, where enough others do: they see the place from
/// behind something, or their poses do not fit. Fewer views are better than those.
void KeepThoseThatShare(std::deque<UsefulView>* views) {
  constexpr auto kEnough = 4;
  const auto shares = [](const UsefulView& view) { return view.shares_landmarks; };
  if (std::count_if(views->begin(), views->end(), shares) < kEnough) return;
  views->erase(std::remove_if(views->begin(), views->end(), std::not_fn(shares)), views->end());
}

}  // namespace

double TypicalDepth(const DepthRange& range) { return std::sqrt(static_cast<double>(range.min) * range.max); }

SourceViewSelection SelectSourceViews(const PosedCamera& reference, const DepthRange& range,
                                      const std::vector<SourceViewCandidate>& candidates, int max_source_views) {
  CheckRange("max_source_views", max_source_views, 1, kMaxSelectedViews);
  CheckDepthRange("choice of source views", range);
  const Reference scene(reference, PlanesOf(range));
  SourceViewSelection selection;
  std::deque<UsefulView> useful;  // they are large: not in one piece
  for (size_t i = 0; i < candidates.size(); ++i) {
    if (const auto view = Assess(scene, candidates[i], i, &selection)) useful.push_back(*view);
  }
  KeepThoseThatShare(&useful);
  const size_t wanted = std::min(useful.size(), static_cast<size_t>(max_source_views));
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

}  // namespace acmp
