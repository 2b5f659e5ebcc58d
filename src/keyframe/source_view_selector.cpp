#include "acmp_mapping/keyframe/source_view_selector.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <unordered_map>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {
namespace {

constexpr double kRadToDeg = 57.295779513082320877;

struct PointHash {
  size_t operator()(const Eigen::Vector3d& point) const {
    const std::hash<double> hash;
    return hash(point.x()) ^ (hash(point.y()) * 0x9e3779b97f4a7c15u) ^ (hash(point.z()) * 0xc2b2ae3d27d4eb4fu);
  }
};

/// Points that stand for the scene as the reference sees it: its landmarks, or a grid of pixels at one depth.
struct ScenePoints {
  std::vector<Eigen::Vector3d> points_in_world;
  std::vector<double> depths;                                     ///< z in the reference view
  std::unordered_map<Eigen::Vector3d, size_t, PointHash> number;  ///< of a landmark; empty for a grid
};

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Eigen::Vector3d CentreInWorld(const Frame& frame) { return frame.cam_from_world.inverse().translation(); }

double MeanFocalLength(const PinholeCamera& camera) { return 0.5 * (camera.fx + camera.fy); }

/// 0 at the least angle, rising to 1 over the best angles, then falling like a Gaussian: wide baselines still match,
/// but foreshortening and occlusion grow.
double AngleWeight(double angle_deg, const SourceViewOptions& options) {
  if (angle_deg < options.best_angle_min_deg) {
    const double span = options.best_angle_min_deg - options.min_angle_deg;
    return span > 0 ? std::max(0.0, (angle_deg - options.min_angle_deg) / span) : 0.0;
  }
  const double excess = std::max(0.0, angle_deg - options.best_angle_max_deg) / options.best_angle_max_deg;
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
  return kRadToDeg * std::atan2(a.cross(b).norm(), a.dot(b));
}

ScenePoints GridAtDepth(const Frame& reference, double depth) {
  constexpr int kCells = 8;
  const RigidTransform world_from_cam = reference.cam_from_world.inverse();
  ScenePoints scene;
  for (int row = 0; row < kCells; ++row) {
    for (int col = 0; col < kCells; ++col) {
      const Eigen::Vector2d pixel((col + 0.5) / kCells * reference.camera.width - 0.5,
                                  (row + 0.5) / kCells * reference.camera.height - 0.5);
      scene.points_in_world.push_back(world_from_cam * reference.camera.Unproject(pixel, depth));
      scene.depths.push_back(depth);
    }
  }
  return scene;
}

/// Shares and medians of 2000 points are good to some 2 %; a whole map of 100,000 would only cost time.
ScenePoints SampleLandmarks(const LandmarksInView& in_view) {
  constexpr size_t kMaxPoints = 2000;
  const size_t step = (in_view.depths.size() + kMaxPoints - 1) / kMaxPoints;
  ScenePoints scene;
  for (size_t i = 0; i < in_view.depths.size(); i += step) {
    scene.number.emplace(in_view.points_in_world[i], scene.depths.size());
    scene.points_in_world.push_back(in_view.points_in_world[i]);
    scene.depths.push_back(in_view.depths[i]);
  }
  return scene;
}

/// Scene points of the reference; empty when its scale is unknown.
ScenePoints MakeScenePoints(const Frame& reference, double fallback_depth, const SourceViewOptions& options) {
  const LandmarksInView in_view =
      FindLandmarksInView(reference.landmarks_in_world, reference.camera, reference.cam_from_world);
  if (in_view.depths.size() >= static_cast<size_t>(options.min_shared_landmarks)) {
    return SampleLandmarks(in_view);
  }
  if (fallback_depth > 0) return GridAtDepth(reference, fallback_depth);
  if (!in_view.depths.empty()) return GridAtDepth(reference, Median(in_view.depths));
  return {};
}

/// How surely the candidate sees each scene point that projects into it: 1 for what its own list of landmarks names
/// (the same bits: one map, or one triangulated point), less for the rest, which may be hidden or have no texture
/// there. A frontend whose points move from keyframe to keyframe names none, and all weigh the same.
std::vector<double> VisibilityWeights(const ScenePoints& scene, const Frame& candidate) {
  // Measured on real scenes against rankings by shared feature tracks: 0.3 agrees best of 0, 0.3, 0.5 and 1.
  constexpr double kNotListed = 0.3;
  if (scene.number.empty()) return std::vector<double>(scene.depths.size(), 1.0);
  std::vector<double> weights(scene.depths.size(), kNotListed);
  for (const Eigen::Vector3d& point : candidate.landmarks_in_world) {
    const auto found = scene.number.find(point);
    if (found != scene.number.end()) weights[found->second] = 1.0;
  }
  return weights;
}

enum class SourceViewVerdict { kUseful, kNoBaseline, kLittleOverlap, kSmallAngle };

/// One candidate, with all that decides whether it is useful.
struct Assessment {
  SourceViewVerdict verdict = SourceViewVerdict::kNoBaseline;
  double score = 0;
  double angle_deg = 0;
};

Assessment AssessByScene(const Frame& reference, const Frame& candidate, const ScenePoints& scene,
                         const SourceViewOptions& options) {
  const Eigen::Vector3d reference_centre = CentreInWorld(reference);
  const Eigen::Vector3d candidate_centre = CentreInWorld(candidate);
  const double focal_ratio = MeanFocalLength(candidate.camera) / MeanFocalLength(reference.camera);
  const std::vector<double> visibility = VisibilityWeights(scene, candidate);
  std::vector<double> angles_deg;
  double weight_sum = 0;
  for (size_t i = 0; i < scene.depths.size(); ++i) {
    const Eigen::Vector3d& point = scene.points_in_world[i];
    const double candidate_depth = DepthInView(point, candidate.camera, candidate.cam_from_world);
    if (candidate_depth <= 0) continue;
    const double angle_deg = AngleDeg(reference_centre - point, candidate_centre - point);
    angles_deg.push_back(angle_deg);
    weight_sum +=
        visibility[i] * AngleWeight(angle_deg, options) * ScaleWeight(focal_ratio * scene.depths[i] / candidate_depth);
  }
  const double total = static_cast<double>(scene.depths.size());
  if (angles_deg.empty() || static_cast<double>(angles_deg.size()) < options.min_overlap * total) {
    return {SourceViewVerdict::kLittleOverlap};
  }
  const double angle_deg = Median(std::move(angles_deg));
  const bool wide_enough = angle_deg >= options.min_angle_deg && weight_sum > 0;
  return {wide_enough ? SourceViewVerdict::kUseful : SourceViewVerdict::kSmallAngle, weight_sum / total, angle_deg};
}

/// Nothing says how far the scene is: views that look the same way, nearest first.
Assessment AssessByPose(const Frame& reference, const Frame& candidate) {
  constexpr double kMinAxisCosine = 0.5;
  const double axis_cosine = reference.cam_from_world.linear().row(2).dot(candidate.cam_from_world.linear().row(2));
  if (axis_cosine < kMinAxisCosine) return {SourceViewVerdict::kLittleOverlap};
  const double baseline = (CentreInWorld(reference) - CentreInWorld(candidate)).norm();
  return {SourceViewVerdict::kUseful, axis_cosine / baseline, 0.0};
}

/// The candidate's centre lies elsewhere. Rounding of the poses alone leaves below 1e-12 of the distance to the world's
/// origin; the matcher refuses less than a millionth of the nearest depth.
bool HasBaseline(const Frame& reference, const Frame& candidate, double typical_depth) {
  const Eigen::Vector3d centre = CentreInWorld(reference);
  const double baseline = (centre - CentreInWorld(candidate)).norm();
  return baseline > 1e-12 * centre.norm() && baseline > 1e-6 * typical_depth;
}

std::vector<Assessment> AssessAll(const Frame& reference, const std::vector<FramePtr>& candidates,
                                  double fallback_depth, const SourceViewOptions& options) {
  Validate(options);
  const ScenePoints scene = MakeScenePoints(reference, fallback_depth, options);
  const double typical_depth = scene.depths.empty() ? 0.0 : Median(scene.depths);
  std::vector<Assessment> assessments(candidates.size());
  for (size_t i = 0; i < candidates.size(); ++i) {
    if (!candidates[i]) throw InvalidInputError(Concat("candidate source view ", i, ": there is no frame"));
    if (!HasBaseline(reference, *candidates[i], typical_depth)) continue;
    assessments[i] = scene.depths.empty() ? AssessByPose(reference, *candidates[i])
                                          : AssessByScene(reference, *candidates[i], scene, options);
  }
  return assessments;
}

}  // namespace

void Validate(const SourceViewOptions& options) {
  CheckRange("source_views.max_source_views", options.max_source_views, 1, kMaxRankedViews);
  CheckRange("source_views.min_angle_deg", options.min_angle_deg, 0.0, 90.0);
  CheckRange("source_views.best_angle_min_deg", options.best_angle_min_deg, options.min_angle_deg, 90.0);
  CheckRange("source_views.best_angle_max_deg", options.best_angle_max_deg, options.best_angle_min_deg, 180.0);
  if (!(options.best_angle_max_deg > 0)) {
    throw InvalidInputError(Concat("source_views.best_angle_max_deg = ", options.best_angle_max_deg, ": must be > 0"));
  }
  CheckRange("source_views.min_overlap", options.min_overlap, 0.0, 1.0);
  CheckRange("source_views.min_shared_landmarks", options.min_shared_landmarks, 1, std::numeric_limits<int>::max());
}

std::vector<RankedSourceView> SelectSourceViews(const Frame& reference, const std::vector<FramePtr>& candidates,
                                                double fallback_depth, const SourceViewOptions& options) {
  const std::vector<Assessment> assessments = AssessAll(reference, candidates, fallback_depth, options);
  std::vector<RankedSourceView> ranked;
  for (size_t i = 0; i < assessments.size(); ++i) {
    if (assessments[i].verdict != SourceViewVerdict::kUseful) continue;
    ranked.push_back({i, assessments[i].score, assessments[i].angle_deg});
  }
  // Stable: equal scores keep the candidates' order on every standard library.
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const RankedSourceView& a, const RankedSourceView& b) { return a.score > b.score; });
  if (ranked.size() > static_cast<size_t>(options.max_source_views)) {
    ranked.resize(static_cast<size_t>(options.max_source_views));
  }
  return ranked;
}

SourceViewCounts CountSourceViews(const Frame& reference, const std::vector<FramePtr>& candidates,
                                  double fallback_depth, const SourceViewOptions& options) {
  SourceViewCounts counts;
  for (const Assessment& assessment : AssessAll(reference, candidates, fallback_depth, options)) {
    counts.useful += assessment.verdict == SourceViewVerdict::kUseful;
    counts.no_baseline += assessment.verdict == SourceViewVerdict::kNoBaseline;
    counts.little_overlap += assessment.verdict == SourceViewVerdict::kLittleOverlap;
    counts.small_angle += assessment.verdict == SourceViewVerdict::kSmallAngle;
    counts.largest_angle_deg = std::max(counts.largest_angle_deg, assessment.angle_deg);
  }
  return counts;
}

}  // namespace acmp
