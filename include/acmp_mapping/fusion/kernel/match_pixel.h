#pragma once

#include <cmath>

#include "acmp_mapping/fusion/kernel/fusion_context.h"

namespace acmp {

/// Not beyond 1e30: products with pixels' coordinates must be finite.
ACMP_HOST_DEVICE inline bool IsKnown(float depth) { return depth > 0 && depth <= 1e30f; }

ACMP_HOST_DEVICE inline bool IsKnown(const Vec3f& normal) { return IsKnown(Dot(normal, normal)); }

/// True when the points of an earlier view used the pixel; never outside fusion.
ACMP_HOST_DEVICE inline bool IsFused(const ImageView<Stamp>& stamps, Stamp current, int col, int row) {
  return stamps.data != nullptr && RelaxedLoad(&stamps(col, row)) < current;
}

struct ReferencePixel {
  int col, row;
  float depth;
  Vec3f homogeneous;  ///< z (u, v, 1)
  Vec3f ray;          ///< from the camera centre to the point, axes of the target frame
  Vec3f normal;       ///< unit, target frame
};

/// Sets what LocateInSource and ProjectBack read: all but ray and normal. False where the depth is unknown.
ACMP_HOST_DEVICE inline bool LoadReferencePlace(const FusionContext& context, int col, int row, ReferencePixel* pixel) {
  const float depth = context.reference.depth(col, row);
  if (!IsKnown(depth)) return false;
  pixel->col = col;
  pixel->row = row;
  pixel->depth = depth;
  pixel->homogeneous = depth * Vec3f{static_cast<float>(col), static_cast<float>(row), 1};
  return true;
}

/// False where depth or normal is unknown.
ACMP_HOST_DEVICE inline bool LoadReferencePixel(const FusionContext& context, int col, int row, ReferencePixel* pixel) {
  if (!LoadReferencePlace(context, col, row, pixel)) return false;
  const Vec3f normal = context.reference.Normal(col, row);
  if (!IsKnown(normal)) return false;
  pixel->ray = context.geometry.target_from_pixel * pixel->homogeneous;
  pixel->normal = Normalized(context.geometry.target_from_camera * normal);
  return true;
}

/// Where a reference pixel's point falls in a source.
struct SourcePlace {
  float x, y;    ///< px
  int col, row;  ///< the nearest pixel
  float depth;   ///< of the point in the source
};

/// False behind and outside the source.
ACMP_HOST_DEVICE inline bool LocateInSource(const FusionSource& source, const Vec3f& homogeneous, SourcePlace* place) {
  const Vec3f projected = source.geometry.to_source * homogeneous + source.geometry.to_source_offset;
  if (!(projected.z > 0)) return false;
  const float x = projected.x / projected.z, y = projected.y / projected.z;
  const int width = source.view.depth.width, height = source.view.depth.height;
  if (!(x >= -0.5f && y >= -0.5f && x < static_cast<float>(width) - 0.5f && y < static_cast<float>(height) - 0.5f)) {
    return false;
  }
  // Half a pixel up and truncated: the nearest pixel, as neither is below -0.5. The sum may round up to the width for
  // the last representable position inside.
  const int nearest_col = static_cast<int>(x + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
  const int nearest_row = static_cast<int>(y + 0.5f);  // NOLINT(bugprone-incorrect-roundings)
  place->col = nearest_col < width ? nearest_col : width - 1;
  place->row = nearest_row < height ? nearest_row : height - 1;
  place->depth = projected.z;
  place->x = x;
  place->y = y;
  return true;
}

/// What a source sees there.
struct ViewAgreement {
  SourcePlace place;
  float depth;           ///< of the source pixel
  Vec3f homogeneous;     ///< the source pixel's point as the reference sees it, z (u, v, 1)
  float squared_px;      ///< of the forward-backward error
  float relative_depth;  ///< absolute difference over the reference pixel's depth
};

/// Depth of the plane of a source's nearest pixel where the point falls. On a floor that is seen at a slant depths of
/// neighbouring pixels differ by percents. The nearest pixel's own where the plane, seen from its edge, leaves that.
ACMP_HOST_DEVICE inline float DepthAtPlace(const FusionSource& source, const SourcePlace& place, float nearest) {
  constexpr float kMaxChange = 0.05f;
  const RayGrid& rays = source.geometry.rays;
  const Vec3f normal = source.view.Normal(place.col, place.row);
  const float col = static_cast<float>(place.col), row = static_cast<float>(place.row);
  const float facing = Dot(normal, rays.Ray(col, row));
  const float there = facing + normal.x * rays.inv_fx * (place.x - col) + normal.y * rays.inv_fy * (place.y - row);
  const float ratio = facing / there;  // NaN without a normal
  return facing < 0 && fabsf(ratio - 1) < kMaxChange ? nearest * ratio : nearest;
}

/// What the source's depth at the place means for the reference; false where it knows none.
/// @param exact_place by the source's plane where the point falls; else by the nearest pixel's depth and centre, as in
///     the papers
ACMP_HOST_DEVICE inline bool ProjectBack(const FusionSource& source, bool exact_place, const ReferencePixel& pixel,
                                         const SourcePlace& place, ViewAgreement* agreement) {
  const float depth = source.view.depth(place.col, place.row);
  if (!IsKnown(depth)) return false;
  const Vec3f homogeneous = exact_place
                                ? DepthAtPlace(source, place, depth) * Vec3f{place.x, place.y, 1}
                                : depth * Vec3f{static_cast<float>(place.col), static_cast<float>(place.row), 1};
  const Vec3f back = source.geometry.to_reference * homogeneous + source.geometry.to_reference_offset;
  const float dx = back.x / back.z - static_cast<float>(pixel.col);
  const float dy = back.y / back.z - static_cast<float>(pixel.row);
  *agreement = {place, depth, back, dx * dx + dy * dy, fabsf(back.z - pixel.depth) / pixel.depth};
  return true;
}

/// True when the source sees something clearly farther away than the reference pixel's point: it violates it (a
/// free-space violation in Merrell et al., Real-Time Visibility-Based Fusion of Depth Maps, ICCV 2007).
ACMP_HOST_DEVICE inline bool ViolatesFreeSpace(const ViewAgreement& agreement) {
  constexpr float kClearly = 1.03f;  // three times what the papers let agree
  return agreement.depth > kClearly * agreement.place.depth;
}

/// 1 - cos of the angle between the rays from the reference and from a source's camera centre to the reference pixel's
/// point. By the sine, as 1 - cos of a small angle would be a difference of numbers that are nearly alike; NaN where
/// the rays are opposite.
/// @param baseline SourceGeometry's
ACMP_HOST_DEVICE inline float TriangulationVersine(const ReferencePixel& pixel, const Vec3f& baseline) {
  const Vec3f ray = pixel.ray - baseline, cross = Cross(pixel.ray, baseline);
  const float norms = sqrtf(Dot(pixel.ray, pixel.ray) * Dot(ray, ray));
  return Dot(cross, cross) / (norms * (norms + Dot(pixel.ray, ray)));
}

/// A source pixel that agrees with a reference pixel.
struct PixelMatch {
  int col, row;
  Vec3f homogeneous;  ///< the source pixel's point as the reference sees it, z (u, v, 1)
  Vec3f normal;       ///< unit, target frame
  float weight;       ///< of the reference pixel's 1
};

/// True when what the source sees agrees with the pixel and no earlier view has used it.
ACMP_HOST_DEVICE inline bool MatchAgreement(const FusionSource& source, const FusionLimits& limits, Stamp current,
                                            const ReferencePixel& pixel, const ViewAgreement& agreement,
                                            PixelMatch* match) {
  const int col = agreement.place.col, row = agreement.place.row;
  if (limits.ByProbability() ? source.view.IsUnsupported(col, row) : source.view.IsUnconfirmed(col, row)) return false;
  if (!(agreement.squared_px < limits.max_squared_px)) return false;
  // A point behind the reference needs no test of its own: it misses the limit on depths, which is below 1.
  if (!(agreement.relative_depth < limits.max_relative_depth)) return false;
  if (IsFused(source.stamps, current, col, row)) return false;
  const Vec3f normal = Normalized(source.geometry.target_from_camera * source.view.Normal(col, row));
  // The cosine is NaN for an unknown normal, which fails the test.
  const float cosine = Dot(normal, pixel.normal);
  if (!(cosine > limits.min_normal_cosine)) return false;

  // Half of the error that GradedAgreement takes for one.
  const float weight =
      limits.ByProbability() ? expf(-0.5f * sqrtf(agreement.squared_px) - 100 * agreement.relative_depth) : 1;
  *match = {col, row, agreement.homogeneous, normal, weight};
  return true;
}

}  // namespace acmp
