#include "acmp_mapping/keyframe/source_view_selection.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {
namespace {

constexpr int kGridCells = 8;  // per axis; 16 x 12 choose no better
constexpr size_t kGridPoints = kGridCells * kGridCells;

using PointWeights = Eigen::Array<double, kGridPoints, 1>;

Eigen::Vector3d CentreInWorld(const PosedCamera& view) { return view.cam_from_world.inverse().translation(); }

double MeanFocalLength(const PinholeCamera& camera) { return 0.5 * (camera.fx + camera.fy); }

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

/// 1 while the two images show a surface at about the same resolution; windows of very different scale do not
/// correlate.
double ScaleWeight(double px_per_unit_ratio) {
  constexpr double kFreeRatio = 1.5;
  const double ratio = std::max(px_per_unit_ratio, 1 / px_per_unit_ratio);
  return ratio <= kFreeRatio ? 1.0 : (kFreeRatio / ratio) * (kFreeRatio / ratio);
}

double AngleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  // atan2 keeps its precision at the small angles that decide whether there is a baseline; acos does not.
  return std::atan2(a.cross(b).norm(), a.dot(b)) / kRadPerDeg<double>;
}

/// What the reference sees, were everything at one depth.
struct Reference {
  Reference(const PosedCamera& view, double depth) : centre(CentreInWorld(view)), depth(depth) {
    const RigidTransform world_from_cam = view.cam_from_world.inverse();
    focal_length = MeanFocalLength(view.camera);
    points.reserve(kGridPoints);
    for (int row = 0; row < kGridCells; ++row) {
      for (int col = 0; col < kGridCells; ++col) {
        const Eigen::Vector2d pixel((col + 0.5) / kGridCells * view.camera.width - 0.5,
                                    (row + 0.5) / kGridCells * view.camera.height - 0.5);
        points.push_back(world_from_cam * view.camera.Unproject(pixel, depth));
      }
    }
  }

  std::vector<Eigen::Vector3d> points;  ///< in the world
  Eigen::Vector3d centre;               ///< of the camera, in the world
  double depth;                         ///< of the points
  double focal_length;                  ///< px
};

/// A candidate that is useful and not chosen yet.
struct UsefulView {
  size_t index = 0;
  bool is_preferred = true;
  Eigen::Vector3d direction;                    ///< of its baseline
  PointWeights weights = PointWeights::Zero();  ///< at the reference's points
  /// Sums of the chosen views' weights there, each times the cosine between the two baselines' directions.
  PointWeights seen = PointWeights::Zero();
  double gain = 0;

  void UpdateAfter(const UsefulView& chosen) {
    seen += std::max(0.0, direction.dot(chosen.direction)) * chosen.weights;
    gain = (weights / (1 + seen)).mean();
  }
};

/// The candidate's centre lies elsewhere. Rounding of the poses alone leaves below 1e-12 of the distance to the world's
/// origin; the matcher refuses less than a millionth of the nearest depth.
bool HasBaseline(const Reference& reference, const Eigen::Vector3d& centre) {
  const double baseline = (centre - reference.centre).norm();
  return baseline > 1e-12 * reference.centre.norm() && baseline > 1e-6 * reference.depth;
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
  UsefulView useful = {index, candidate.is_preferred, (centre - reference.centre).normalized()};
  const double focal_ratio = MeanFocalLength(view.camera) / reference.focal_length;
  std::vector<double> angles_deg;
  int num_wide = 0;
  for (size_t i = 0; i < kGridPoints; ++i) {
    const Eigen::Vector3d& point = reference.points[i];
    const double depth = DepthInView(point, view.camera, view.cam_from_world);
    if (depth <= 0) continue;
    angles_deg.push_back(AngleDeg(reference.centre - point, centre - point));
    num_wide += angles_deg.back() >= kMinSourceAngleDeg;
    useful.weights[static_cast<Eigen::Index>(i)] =
        AngleWeight(angles_deg.back()) * ScaleWeight(focal_ratio * reference.depth / depth);
  }
  constexpr double kLeastPoints = kMinSourceOverlap * kGridPoints;
  if (static_cast<double>(angles_deg.size()) < kLeastPoints) {
    ++selection->num_without_overlap;
    return std::nullopt;
  }
  selection->largest_angle_deg = std::max(selection->largest_angle_deg, Median(std::move(angles_deg)));
  // Not the median: a camera that moves ahead sees near things under wide angles and most of the scene under none.
  if (num_wide < kLeastPoints || useful.weights.maxCoeff() <= 0) {
    ++selection->num_with_small_angle;
    return std::nullopt;
  }
  ++selection->num_useful;
  useful.gain = useful.weights.mean();
  return useful;
}

bool IsLessUseful(const UsefulView& a, const UsefulView& b) {
  return a.is_preferred != b.is_preferred ? b.is_preferred : a.gain < b.gain;
}

}  // namespace

void Validate(const SourceViewOptions& options) {
  CheckRange("source_views.max_source_views", options.max_source_views, 1, kMaxSelectedViews);
}

double TypicalDepth(const DepthRange& range) { return std::sqrt(static_cast<double>(range.min) * range.max); }

SourceViewSelection SelectSourceViews(const PosedCamera& reference, double typical_depth,
                                      const std::vector<SourceViewCandidate>& candidates,
                                      const SourceViewOptions& options) {
  Validate(options);
  if (!(typical_depth > 0) || !std::isfinite(typical_depth)) {
    throw InvalidInputError(
        Concat("choice of source views: typical_depth = ", typical_depth, ": must be positive and finite"));
  }
  const Reference scene(reference, typical_depth);
  SourceViewSelection selection;
  std::vector<UsefulView> useful;
  for (size_t i = 0; i < candidates.size(); ++i) {
    if (auto view = Assess(scene, candidates[i], i, &selection)) useful.push_back(*view);
  }
  const size_t wanted = std::min(useful.size(), static_cast<size_t>(options.max_source_views));
  while (selection.views.size() < wanted) {
    // The first of equals: all candidates keep their order.
    const auto best = std::max_element(useful.begin(), useful.end(), IsLessUseful);
    const UsefulView chosen = *best;
    useful.erase(best);
    selection.views.push_back({chosen.index, chosen.gain});
    selection.gain += chosen.gain;
    for (UsefulView& view : useful) view.UpdateAfter(chosen);
  }
  return selection;
}

}  // namespace acmp
