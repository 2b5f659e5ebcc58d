#include "acmp_mapping/keyframe/source_view_selector.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <map>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr double kRadToDeg = 57.295779513082320877;
// Full score between these triangulation angles; up to 20 degrees gives up to 1 % fewer right depths.
constexpr double kBestAngleMinDeg = 5.0, kBestAngleMaxDeg = 10.0;
constexpr size_t kMinLandmarks = 10;  // in view; below, a grid of pixels at one depth stands in for them

/// Of the coordinates' bits, mixed as splitmix64 does.
uint64_t HashOf(const Eigen::Vector3d& point) {
  uint64_t hash = 0;
  for (int i = 0; i < 3; ++i) {
    uint64_t bits = 0;
    std::memcpy(&bits, &point[i], sizeof(bits));
    hash = (hash ^ bits) + 0x9e3779b97f4a7c15u;
    hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9u;
    hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebu;
    hash ^= hash >> 31;
  }
  return hash;
}

/// Points that stand for the scene as the reference sees it: its landmarks, or a grid of pixels at one depth.
struct ScenePoints {
  std::vector<Eigen::Vector3d> points_in_world;
  std::vector<double> depths;  ///< z in the reference view
  bool are_landmarks = false;  ///< else a grid
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
double AngleWeight(double angle_deg) {
  if (angle_deg < kBestAngleMinDeg) {
    return std::max(0.0, (angle_deg - kMinSourceAngleDeg) / (kBestAngleMinDeg - kMinSourceAngleDeg));
  }
  const double excess = std::max(0.0, angle_deg - kBestAngleMaxDeg) / kBestAngleMaxDeg;
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

/// Scene points of the reference; empty when its scale is unknown.
ScenePoints MakeScenePoints(const FrameLandmarks& reference, double fallback_depth) {
  const LandmarksInView& sample = reference.sample();
  if (reference.num_in_view() >= kMinLandmarks) return {sample.points_in_world, sample.depths, true};
  if (fallback_depth > 0) return GridAtDepth(reference.frame(), fallback_depth);
  if (!sample.depths.empty()) return GridAtDepth(reference.frame(), Median(sample.depths));
  return {};
}

/// How surely the candidate sees a scene point that projects into it: 1 for what its own list of landmarks names (the
/// same bits: one map, or one triangulated point), less for the rest, which may be hidden or have no texture there. A
/// frontend whose points move from keyframe to keyframe names none, and all weigh the same.
double VisibilityWeight(const ScenePoints& scene, size_t i, const FrameLandmarks& candidate) {
  // Measured on real scenes against rankings by shared feature tracks: 0.3 agrees best of 0, 0.3, 0.5 and 1.
  constexpr double kNotListed = 0.3;
  return !scene.are_landmarks || candidate.Lists(scene.points_in_world[i]) ? 1.0 : kNotListed;
}

enum class SourceViewVerdict { kUseful, kNoBaseline, kLittleOverlap, kSmallAngle };

/// One candidate, with all that decides whether it is useful.
struct Assessment {
  SourceViewVerdict verdict = SourceViewVerdict::kNoBaseline;
  double score = 0;
  double angle_deg = 0;
};

Assessment AssessByScene(const Frame& reference, const FrameLandmarks& candidate_landmarks, const ScenePoints& scene) {
  const Frame& candidate = candidate_landmarks.frame();
  const Eigen::Vector3d reference_centre = CentreInWorld(reference);
  const Eigen::Vector3d candidate_centre = CentreInWorld(candidate);
  const double focal_ratio = MeanFocalLength(candidate.camera) / MeanFocalLength(reference.camera);
  std::vector<double> angles_deg;
  int num_wide = 0;
  double weight_sum = 0;
  for (size_t i = 0; i < scene.depths.size(); ++i) {
    const Eigen::Vector3d& point = scene.points_in_world[i];
    const double candidate_depth = DepthInView(point, candidate.camera, candidate.cam_from_world);
    if (candidate_depth <= 0) continue;
    const double angle_deg = AngleDeg(reference_centre - point, candidate_centre - point);
    angles_deg.push_back(angle_deg);
    num_wide += angle_deg >= kMinSourceAngleDeg;
    weight_sum += VisibilityWeight(scene, i, candidate_landmarks) * AngleWeight(angle_deg) *
                  ScaleWeight(focal_ratio * scene.depths[i] / candidate_depth);
  }
  const double total = static_cast<double>(scene.depths.size());
  if (angles_deg.empty() || static_cast<double>(angles_deg.size()) < kMinSourceOverlap * total) {
    return {SourceViewVerdict::kLittleOverlap};
  }
  // Not the median: a camera that moves ahead sees near things under wide angles and most of the scene under none.
  const bool wide_enough = num_wide >= kMinSourceOverlap * total && weight_sum > 0;
  const double angle_deg = Median(std::move(angles_deg));
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

}  // namespace

void Validate(const SourceViewOptions& options) {
  CheckRange("source_views.max_source_views", options.max_source_views, 1, kMaxRankedViews);
}

FrameLandmarks::FrameLandmarks(FramePtr frame) : frame_(std::move(frame)) {
  if (!frame_) throw InvalidInputError("choice of source views: there is no frame");
  constexpr size_t kMaxSample = 2000;  // a whole map of 100,000 would only cost time and memory
  const LandmarksInView in_view =
      FindLandmarksInView(frame_->landmarks_in_world, frame_->camera, frame_->cam_from_world);
  const size_t count = in_view.depths.size(), step = (count + kMaxSample - 1) / kMaxSample;
  for (size_t i = 0; i < count; i += step) {
    sample_.points_in_world.push_back(in_view.points_in_world[i]);
    sample_.depths.push_back(in_view.depths[i]);
  }
  listed_.reserve(count);
  for (const Eigen::Vector3d& point : in_view.points_in_world) listed_.push_back(HashOf(point));
  std::sort(listed_.begin(), listed_.end());
}

bool FrameLandmarks::Lists(const Eigen::Vector3d& point_in_world) const {
  return std::binary_search(listed_.begin(), listed_.end(), HashOf(point_in_world));
}

struct SourceViewSelector::Impl {
  FrameLandmarksPtr reference;
  int max_source_views = 0;
  ScenePoints scene;
  double typical_depth = 0;
  /// Candidates that are gone have entries that nothing equals.
  std::map<std::weak_ptr<const FrameLandmarks>, Assessment, std::owner_less<>> known;

  Assessment Assess(const FrameLandmarks& candidate) const {
    const Frame& frame = reference->frame();
    if (!HasBaseline(frame, candidate.frame(), typical_depth)) return {};
    return scene.depths.empty() ? AssessByPose(frame, candidate.frame()) : AssessByScene(frame, candidate, scene);
  }

  std::vector<Assessment> AssessAll(const std::vector<FrameLandmarksPtr>& candidates) {
    for (auto entry = known.begin(); entry != known.end();) {
      entry = entry->first.expired() ? known.erase(entry) : std::next(entry);
    }
    std::vector<Assessment> assessments;
    assessments.reserve(candidates.size());
    for (size_t i = 0; i < candidates.size(); ++i) {
      if (!candidates[i]) throw InvalidInputError(Concat("candidate source view ", i, ": there is no frame"));
      auto found = known.find(candidates[i]);
      if (found == known.end()) found = known.emplace(candidates[i], Assess(*candidates[i])).first;
      assessments.push_back(found->second);
    }
    return assessments;
  }
};

SourceViewSelector::SourceViewSelector(const FrameLandmarksPtr& reference, double fallback_depth,
                                       const SourceViewOptions& options)
    : impl_(std::make_unique<Impl>()) {
  Validate(options);
  if (!reference) throw InvalidInputError("choice of source views: there is no reference");
  impl_->reference = reference;
  impl_->max_source_views = options.max_source_views;
  impl_->scene = MakeScenePoints(*reference, fallback_depth);
  if (!impl_->scene.depths.empty()) impl_->typical_depth = Median(impl_->scene.depths);
}

SourceViewSelector::~SourceViewSelector() = default;
SourceViewSelector::SourceViewSelector(SourceViewSelector&& other) noexcept = default;
SourceViewSelector& SourceViewSelector::operator=(SourceViewSelector&& other) noexcept = default;

std::vector<RankedSourceView> SourceViewSelector::Select(const std::vector<FrameLandmarksPtr>& candidates) {
  const std::vector<Assessment> assessments = impl_->AssessAll(candidates);
  std::vector<RankedSourceView> ranked;
  for (size_t i = 0; i < assessments.size(); ++i) {
    if (assessments[i].verdict != SourceViewVerdict::kUseful) continue;
    ranked.push_back({i, assessments[i].score, assessments[i].angle_deg});
  }
  // Stable: equal scores keep the candidates' order on every standard library.
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const RankedSourceView& a, const RankedSourceView& b) { return a.score > b.score; });
  if (ranked.size() > static_cast<size_t>(impl_->max_source_views)) {
    ranked.resize(static_cast<size_t>(impl_->max_source_views));
  }
  return ranked;
}

SourceViewCounts SourceViewSelector::Count(const std::vector<FrameLandmarksPtr>& candidates) {
  SourceViewCounts counts;
  for (const Assessment& assessment : impl_->AssessAll(candidates)) {
    counts.useful += assessment.verdict == SourceViewVerdict::kUseful;
    counts.no_baseline += assessment.verdict == SourceViewVerdict::kNoBaseline;
    counts.little_overlap += assessment.verdict == SourceViewVerdict::kLittleOverlap;
    counts.small_angle += assessment.verdict == SourceViewVerdict::kSmallAngle;
    counts.largest_angle_deg = std::max(counts.largest_angle_deg, assessment.angle_deg);
  }
  return counts;
}

}  // namespace acmp
