#pragma once

#include "acmp_mapping/fusion/kernel/confidence.h"
#include "acmp_mapping/fusion/kernel/match_sum.h"

namespace acmp {

/// True when a pixel may be a point, whatever its confidence: it has a depth, and nothing speaks against it.
template <class View>
ACMP_HOST_DEVICE inline bool MayBePoint(const FusionContext<View>& context, int col, int row) {
  return context.limits.ByProbability() ? !context.reference.IsUnsupported(col, row)
                                        : !context.reference.IsGuess(col, row);
}

/// One pixel of FilterByConsistency: true when it becomes a point, which it then sets.
/// @param context with `log_odds` of all pixels
template <int kMaxSources, class View>
ACMP_HOST_DEVICE inline bool CheckPixel(const FusionContext<View>& context, int col, int row, float* confidence,
                                        SurfacePoint* point) {
  const double probability = ConfidenceOf(context, col, row);
  *confidence = static_cast<float>(probability);
  ReferencePixel pixel;
  if (!(probability >= context.limits.min_confidence) || !MayBePoint(context, col, row)) return false;
  if (!LoadReferencePixel(context, col, row, &pixel)) return false;
  MatchSum<kMaxSources> sum;
  SumMatches(context, pixel, &sum);
  if (sum.count < context.limits.min_consistent_views) return false;
  *point = Average(context.geometry, pixel, sum, probability);
  return true;
}

/// Stamps the pixel and its matches. Other pixels of the reference may do so at the same time and to the same matches:
/// all write the same, and a pixel with this stamp still counts as unused to each of them.
template <int kMaxSources, class View>
ACMP_HOST_DEVICE inline void StampUsed(const FusionContext<View>& context, const ReferencePixel& pixel,
                                       const MatchSum<kMaxSources>& sum) {
  RelaxedStore(&context.stamps(pixel.col, pixel.row), context.current);
  for (int i = 0; i < context.num_sources; ++i) {
    if ((sum.matched[WordOf<kMaxSources>(i)] >> (i % 32) & 1u) == 0) continue;
    const FusionSource<View>& source = context.sources[i];
    SourcePlace place;
    if (!LocateInSource(source, pixel.homogeneous, &place)) continue;
    RelaxedStore(&source.stamps(place.col, place.row), context.current);
  }
}

/// One pixel of FusionEngine::FuseView: true when it becomes a point, which it then sets. Pixels of the
/// view may be run at the same time and in any order; views one after the other.
/// @param context with `log_odds` of all pixels
template <int kMaxSources, class View>
ACMP_HOST_DEVICE inline bool FusePixel(const FusionContext<View>& context, int col, int row, SurfacePoint* point) {
  if (IsUsed(context.stamps, context.current, col, row) || !MayBePoint(context, col, row)) return false;
  const double confidence = ConfidenceOf(context, col, row);
  ReferencePixel pixel;
  if (!(confidence >= context.limits.min_confidence) || !LoadReferencePixel(context, col, row, &pixel)) return false;
  MatchSum<kMaxSources> sum;
  SumMatches(context, pixel, &sum);
  if (sum.count < context.limits.min_consistent_views) return false;
  StampUsed(context, pixel, sum);
  *point = Average(context.geometry, pixel, sum, confidence);
  return true;
}

}  // namespace acmp
