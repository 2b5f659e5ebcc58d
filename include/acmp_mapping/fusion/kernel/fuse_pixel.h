#pragma once

#include "acmp_mapping/fusion/kernel/confidence.h"
#include "acmp_mapping/fusion/kernel/match_pixel.h"
#include "acmp_mapping/fusion/point_cloud.h"

namespace acmp {

/// A reference pixel and its matches added up, so that no list of matches is kept.
struct MatchSum {
  int count;                              ///< of matches
  float weight;                           ///< as all below with the reference pixel
  Vec3f homogeneous;                      ///< z (u, v, 1) in the reference, times weight
  Vec3f normal;                           ///< target frame, times weight
  unsigned red, green, blue, num_colors;  ///< of the pixels whose view has colours
  uint32_t matched;                       ///< a bit per source
};

ACMP_HOST_DEVICE inline void AddColor(const FusionMaps& view, int col, int row, MatchSum* sum) {
  if (view.color.empty()) return;
  const Rgb color = view.color(col, row);
  sum->red += color.r;
  sum->green += color.g;
  sum->blue += color.b;
  ++sum->num_colors;
}

/// The sum of the reference pixel alone.
ACMP_HOST_DEVICE inline void StartSum(const FusionMaps& reference, const ReferencePixel& pixel, MatchSum* sum) {
  sum->count = 0;
  sum->weight = 1;
  sum->homogeneous = pixel.homogeneous;
  sum->normal = pixel.normal;
  sum->red = sum->green = sum->blue = sum->num_colors = sum->matched = 0;
  AddColor(reference, pixel.col, pixel.row, sum);
}

ACMP_HOST_DEVICE inline void AddMatch(const FusionMaps& view, int source, const PixelMatch& match, MatchSum* sum) {
  ++sum->count;
  sum->weight += match.weight;
  sum->homogeneous = sum->homogeneous + match.weight * match.homogeneous;
  sum->normal = sum->normal + match.weight * match.normal;
  sum->matched |= 1u << source;
  AddColor(view, match.col, match.row, sum);
}

/// The reference pixel and what agrees with it.
ACMP_HOST_DEVICE inline void SumMatches(const FusionContext& context, const ReferencePixel& pixel, MatchSum* sum) {
  StartSum(context.reference, pixel, sum);
  for (int i = 0; i < context.num_sources; ++i) {
    const FusionSource& source = context.sources[i];
    SourcePlace place;
    if (!LocateInSource(source, pixel.homogeneous, &place)) continue;
    ViewAgreement agreement;
    if (!ProjectBack(source, context.limits.ByProbability(), pixel, place, &agreement)) continue;
    PixelMatch match;
    if (MatchAgreement(source, context.limits, context.current, pixel, agreement, &match)) {
      AddMatch(source.view, i, match, sum);
    }
  }
}

/// Sum over count, rounded to nearest; 0 of none.
ACMP_HOST_DEVICE inline unsigned char RoundedMean(unsigned sum, unsigned count) {
  return count == 0 ? 0 : static_cast<unsigned char>((2 * sum + count) / (2 * count));
}

/// Mean of the pixel and its matches, target frame.
ACMP_HOST_DEVICE inline SurfacePoint Average(const ReferenceGeometry& geometry, const ReferencePixel& pixel,
                                             const MatchSum& sum, float confidence) {
  const Vec3f mean = (1 / sum.weight) * sum.homogeneous;
  // With limits near 180 degrees normals may cancel; the reference's own is then as good as any.
  const bool cancels = !(Norm(sum.normal) > 1e-6f);
  SurfacePoint point;
  point.position = geometry.target_from_pixel * mean + geometry.center;
  point.normal = cancels ? pixel.normal : Normalized(sum.normal);
  point.color = {RoundedMean(sum.red, sum.num_colors), RoundedMean(sum.green, sum.num_colors),
                 RoundedMean(sum.blue, sum.num_colors)};
  point.confidence = confidence;
  return point;
}

/// True when a pixel may be a point, whatever its confidence: it has a depth, and nothing speaks against it.
ACMP_HOST_DEVICE inline bool MayBePoint(const FusionContext& context, int col, int row) {
  return context.limits.ByProbability() ? !context.reference.IsUnsupported(col, row)
                                        : !context.reference.IsUnconfirmed(col, row);
}

/// The mean of a pixel and of what agrees with it; false where it becomes no point.
/// @param sum set to both where it does
ACMP_HOST_DEVICE inline bool MakePoint(const FusionContext& context, int col, int row, float confidence,
                                       ReferencePixel* pixel, MatchSum* sum, SurfacePoint* point) {
  if (!(confidence >= context.limits.min_confidence) || !MayBePoint(context, col, row)) return false;
  if (!LoadReferencePixel(context, col, row, pixel)) return false;
  SumMatches(context, *pixel, sum);
  if (sum->count < context.limits.min_consistent_views) return false;
  *point = Average(context.geometry, *pixel, *sum, confidence);
  return true;
}

/// One pixel of FilterByConsistency: true when it becomes a point, which it then sets.
/// @param context with `log_odds` of all pixels
ACMP_HOST_DEVICE inline bool CheckPixel(const FusionContext& context, int col, int row, float* confidence,
                                        SurfacePoint* point) {
  *confidence = ConfidenceOf(context, col, row);
  ReferencePixel pixel;
  MatchSum sum;
  return MakePoint(context, col, row, *confidence, &pixel, &sum, point);
}

/// Stamps the pixel and its matches. Other pixels of the reference may do so at the same time and to the same matches:
/// all write the same, and a pixel with this stamp still counts as unused to each of them.
ACMP_HOST_DEVICE inline void StampFused(const FusionContext& context, const ReferencePixel& pixel,
                                        const MatchSum& sum) {
  RelaxedStore(&context.stamps(pixel.col, pixel.row), context.current);
  for (int i = 0; i < context.num_sources; ++i) {
    if ((sum.matched >> i & 1u) == 0) continue;
    const FusionSource& source = context.sources[i];
    SourcePlace place;
    if (!LocateInSource(source, pixel.homogeneous, &place)) continue;
    RelaxedStore(&source.stamps(place.col, place.row), context.current);
  }
}

/// One pixel of DepthEngine::FuseView: true when it becomes a point, which it then sets. Pixels of the
/// view may be run at the same time and in any order; views one after the other.
/// @param context with `log_odds` of all pixels
ACMP_HOST_DEVICE inline bool FusePixel(const FusionContext& context, int col, int row, SurfacePoint* point) {
  if (IsFused(context.stamps, context.current, col, row) || !MayBePoint(context, col, row)) return false;
  ReferencePixel pixel;
  MatchSum sum;
  if (!MakePoint(context, col, row, ConfidenceOf(context, col, row), &pixel, &sum, point)) return false;
  StampFused(context, pixel, sum);
  return true;
}

}  // namespace acmp
