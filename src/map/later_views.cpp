#include "acmp_mapping/map/later_views.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "acmp_mapping/mesh/splat_points.h"

namespace acmp {
namespace {

constexpr float kConfirmingDepth = 0.02f;  ///< relative: as fusion lets views agree
constexpr float kClearlyFarther = 1.05f;

enum class Look : uint8_t { kNothing, kConfirms, kThrough };

/// A point is looked through where all depths around it, 3 x 3 px, are known and clearly farther: beside an outline one
/// of them is not.
Look LookAtPoint(const SeenDepth& seen, const Eigen::Vector3d& point) {
  if (!(point.z() > 0)) return Look::kNothing;
  const Eigen::Vector2d pixel = seen.camera.Project(point);
  if (!seen.camera.Contains(pixel)) return Look::kNothing;
  const int col = static_cast<int>(std::floor(pixel.x() + 0.5)), row = static_cast<int>(std::floor(pixel.y() + 0.5));
  const auto z = static_cast<float>(point.z());
  Look look = Look::kThrough;
  for (int r = row - 1; r <= row + 1; ++r) {
    for (int c = col - 1; c <= col + 1; ++c) {
      const float depth = seen.depth.View().Contains(c, r) ? seen.depth(c, r) : 0;
      if (std::abs(depth - z) < kConfirmingDepth * z) return Look::kConfirms;
      if (!(depth > kClearlyFarther * z)) look = Look::kNothing;
    }
  }
  return look;
}

float TimesOdds(float confidence, float factor) { return confidence * factor / (1 + confidence * (factor - 1)); }

void CountOne(uint8_t* count) { *count = static_cast<uint8_t>(std::min(*count + 1, 255)); }

bool HasGone(const LaterViews& views) {
  constexpr int kSeveral = 3, kOutweigh = 2;
  return views.through >= kSeveral && views.through > kOutweigh * views.confirming;
}

}  // namespace

SeenDepth SeenDepthOf(const PointCloud& points_in_camera, double spacing) {
  SurfaceMaps maps = SplatPoints(points_in_camera, RigidTransform::Identity(), spacing);
  return {maps.camera.camera, std::move(maps.depth)};
}

bool TakeLaterView(const SeenDepth& seen, const RigidTransform& later_from_points, double scale, PointCloud* points,
                   std::vector<LaterViews>* views) {
  constexpr float kConfirmed = 1.2f, kLookedThrough = 0.5f;
  if (seen.depth.empty()) return false;
  std::vector<Look> looks(points->size());
  tbb::parallel_for(size_t{0}, looks.size(), [&](size_t i) {
    const Vec3f& p = (*points)[i].position;
    looks[i] = LookAtPoint(seen, later_from_points * (scale * Eigen::Vector3d(p.x, p.y, p.z)));
  });
  const auto confirming = std::count(looks.begin(), looks.end(), Look::kConfirms);
  if (confirming == 0 || std::count(looks.begin(), looks.end(), Look::kThrough) > confirming) return false;
  size_t kept = 0;
  for (size_t i = 0; i < looks.size(); ++i) {
    SurfacePoint point = (*points)[i];
    LaterViews of_point = (*views)[i];
    if (looks[i] == Look::kConfirms) {
      CountOne(&of_point.confirming);
      point.confidence = TimesOdds(point.confidence, kConfirmed);
    } else if (looks[i] == Look::kThrough) {
      CountOne(&of_point.through);
      point.confidence = TimesOdds(point.confidence, kLookedThrough);
      if (HasGone(of_point)) continue;
    }
    (*points)[kept] = point;
    (*views)[kept++] = of_point;
  }
  points->resize(kept);
  views->resize(kept);
  return true;
}

}  // namespace acmp
