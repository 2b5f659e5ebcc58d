#pragma once

#include "acmp_mapping/fusion/kernel/expected_error.h"
#include "acmp_mapping/fusion/kernel/match_sum.h"

namespace acmp {

struct PixelConsistency {
  int consistent_views;
  float confidence;  ///< 0 without depth
  bool accepted;     ///< the pixel becomes a point
};

/// One pixel of FilterByConsistency. Sets `point` when the pixel is accepted.
/// @param context with `log_error` of all pixels
template <int kMaxSources, class View>
ACMP_HOST_DEVICE inline PixelConsistency CheckPixel(const FusionContext<View>& context, int col, int row,
                                                    SurfacePoint* point) {
  const double confidence = ConfidenceOf(context, col, row);
  ReferencePixel pixel;
  if (!LoadReferencePixel(context, col, row, &pixel)) return {0, static_cast<float>(confidence), false};
  MatchSum<kMaxSources> sum;
  SumMatches(context, pixel, &sum);
  const bool accepted = !context.reference.IsGuess(col, row) && HasEnoughMatches(context.limits, sum);
  if (accepted) *point = Average(context.geometry, pixel, sum, confidence);
  return {sum.count, static_cast<float>(confidence), accepted};
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
/// @param context with `log_error` of all pixels
template <int kMaxSources, class View>
ACMP_HOST_DEVICE inline bool FusePixel(const FusionContext<View>& context, int col, int row, SurfacePoint* point) {
  ReferencePixel pixel;
  if (IsUsed(context.stamps, context.current, col, row) || context.reference.IsGuess(col, row)) return false;
  if (!LoadReferencePixel(context, col, row, &pixel)) return false;
  MatchSum<kMaxSources> sum;
  SumMatches(context, pixel, &sum);
  if (!HasEnoughMatches(context.limits, sum)) return false;
  StampUsed(context, pixel, sum);
  *point = Average(context.geometry, pixel, sum, ConfidenceOf(context, col, row));
  return true;
}

}  // namespace acmp
