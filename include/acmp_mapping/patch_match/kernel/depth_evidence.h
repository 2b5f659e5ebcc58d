#pragma once

#include <cmath>
#include <cstdint>

#include "acmp_mapping/common/thread_group.h"
#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"

namespace acmp {

/// The plane itself and the same one farther away: factors of its inverse depth. The last is nearly at infinity, where
/// a sky is.
constexpr int kEvidencePlanes = 6;
ACMP_HOST_DEVICE constexpr float EvidencePlane(int i) {
  return i == 0 ? 1.0f : i == 1 ? 0.9f : i == 2 ? 0.8f : i == 3 ? 0.6f : i == 4 ? 0.3f : 0.01f;
}

/// The window of a pixel as it is compared here: with the same weight for all samples but those that the mask ignores,
/// as texture that is hardly more than noise shows in the sum of many samples only. What would lie outside the image is
/// the nearest in it.
/// @tparam kMasked some samples may be such that the mask ignores them
template <bool kMasked>
struct PlainWindow {
  ReferencePatch patch;
  float col[kPatchWidth], row[kPatchWidth];  ///< of the samples
  float pixel_col, pixel_row;
  int count = kPatchSamples;  ///< of the samples that the mask does not ignore
  bool is_whole;              ///< all of it lies in the image

  /// Weight of sample i: 0 or 1.
  ACMP_HOST_DEVICE float Weight(int i) const { return kMasked ? patch.samples[i].weight : 1.0f; }
};

/// Place of sample `i` among the columns and rows of a window.
ACMP_HOST_DEVICE constexpr int PlaceOfCol(int i) { return (WindowCol(i) + kPatchRadius) / kPatchStep; }
ACMP_HOST_DEVICE constexpr int PlaceOfRow(int i) { return (WindowRow(i) + kPatchRadius) / kPatchStep; }

template <bool kMasked, class Sampler>
ACMP_HOST_DEVICE inline PlainWindow<kMasked> LoadPlainWindow(const MatchContext<Sampler>& context, int col, int row) {
  const auto clamped = [](int value, int last) { return value < 0 ? 0 : value > last ? last : value; };
  int cols[kPatchWidth], rows[kPatchWidth];
  PlainWindow<kMasked> window;
  ACMP_UNROLL
  for (int i = 0; i < kPatchWidth; ++i) {
    cols[i] = clamped(col + i * kPatchStep - kPatchRadius, context.width - 1);
    rows[i] = clamped(row + i * kPatchStep - kPatchRadius, context.height - 1);
    window.col[i] = static_cast<float>(cols[i]);
    window.row[i] = static_cast<float>(rows[i]);
  }
  window.pixel_col = static_cast<float>(col);
  window.pixel_row = static_cast<float>(row);
  window.is_whole = context.Contains(col - kPatchRadius, row - kPatchRadius) &&
                    context.Contains(col + kPatchRadius, row + kPatchRadius);
  window.patch.center = context.sampler.Reference(col, row);
  float sum = 0, squares = 0;
  ACMP_UNROLL
  for (int i = 0; i < kPatchSamples; ++i) {
    const int x = cols[PlaceOfCol(i)], y = rows[PlaceOfRow(i)];
    if (kMasked && context.IsMasked(x, y)) {
      window.patch.samples[i] = {0, 0};
      --window.count;
      continue;
    }
    const float value = context.sampler.Reference(x, y) - window.patch.center;
    window.patch.samples[i] = {value, 1.0f};
    sum += value;
    squares += value * value;
  }
  SetMoments(static_cast<float>(window.count), sum, squares, &window.patch);
  return window;
}

/// Ncc's sums over a plain window's samples by one thread alone. @param warp as of the pixel (0, 0). Samplers may
/// overload it, as SumWindowsOfView.
template <bool kMasked, class Sampler>
ACMP_HOST_DEVICE inline WindowSums SumPlainWindow(const Sampler& sampler, int view, const PlaneWarp& warp,
                                                  const PlainWindow<kMasked>& window) {
  const int image = sampler.ImageOf(view);
  WindowSums sums;
  ACMP_UNROLL
  for (int i = 0; i < kPatchSamples; ++i) {
    const Vec3f start = window.row[PlaceOfRow(i)] * warp.step_row + warp.center;
    const Vec3f projected = window.col[PlaceOfCol(i)] * warp.step_col + start;
    const float inv_z = Reciprocal(projected.z);
    const float x = projected.x * inv_z + Sampler::kPixelCenter, y = projected.y * inv_z + Sampler::kPixelCenter;
    const PatchSample sample = {window.patch.samples[i].value, window.Weight(i)};
    Ncc::Add(sample, window.patch.center, sampler.SourceAt(image, x, y), &sums);
  }
  return sums;
}

/// Whether a warped window lies in the source's image: where its corners are in front of the camera and inside, all of
/// it is, as the warp keeps what is convex so.
template <bool kMasked>
ACMP_HOST_DEVICE inline bool ContainsWindow(const SourceView& source, const PlaneWarp& warp,
                                            const PlainWindow<kMasked>& window) {
  bool is_inside = true;
  ACMP_UNROLL
  for (int i = 0; i < 4; ++i) {
    const Vec3f corner = window.col[i % 2 * (kPatchWidth - 1)] * warp.step_col +
                         (window.row[i / 2 * (kPatchWidth - 1)] * warp.step_row + warp.center);
    const float last_x = static_cast<float>(source.width - 1), last_y = static_cast<float>(source.height - 1);
    is_inside = is_inside && corner.z > 0 && corner.x >= 0 && corner.y >= 0 && corner.x <= last_x * corner.z &&
                corner.y <= last_y * corner.z;
  }
  return is_inside;
}

/// The part of the window's variance that a gain and an offset of the source's grey values do not explain, grey
/// levels^2; -1 where not all of the window falls into the source's image, or it reaches what the source's mask
/// ignores.
/// @param dual of the plane (PlaneDual)
template <bool kMasked, class Sampler>
ACMP_HOST_DEVICE inline float UnexplainedVariance(const MatchContext<Sampler>& context,
                                                  const PlainWindow<kMasked>& window, const Vec3f& dual, int view) {
  const SourceView& source = context.sources[view];
  const PlaneWarp warp = MakePlaneWarp(source, dual, 0, 0);
  if (!ContainsWindow(source, warp, window)) return -1;
  if (Sampler::kHasMasks && context.source_mask_distances != nullptr &&
      ReachesMasked(context, view, MakePlaneWarp(source, dual, window.pixel_col, window.pixel_row))) {
    return -1;
  }
  const ReferencePatch& patch = window.patch;
  const WindowSums sums = SumPlainWindow(context.sampler, view, warp, window);
  const float mean = patch.inv_sum_weight * sums.ws;
  const float variance = patch.inv_sum_weight * sums.wss - mean * mean;
  const float covariance = patch.inv_sum_weight * sums.wrs - patch.mean * mean;
  if (!(covariance > 0 && variance > 0)) return patch.variance;
  const float rest = patch.variance - covariance * covariance / variance;
  return rest > 0 ? rest : 0;
}

/// The source views whose depths agree with a pixel's, as bits.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline uint32_t AgreeingViews(const MatchContext<Sampler>& context, float depth, int col, int row,
                                               const Group& group) {
  constexpr float kAgreementPx = 2.0f;
  static_assert(kMaxSourceViews <= 32, "one bit per view");
  uint32_t agreeing = 0;
  for (int view = group.Rank(); view < context.num_sources; view += Group::kSize) {
    if (GeometricError(context, depth, col, row, view) < kAgreementPx) agreeing |= 1u << view;
  }
  return group.Union(agreeing);
}

/// DepthEvidence; kMasked: of a pixel near one that the mask ignores.
template <bool kMasked, class Sampler, class Group>
ACMP_HOST_DEVICE inline float EvidenceOfWindow(const MatchContext<Sampler>& context, int col, int row,
                                               const Group& group) {
  constexpr float kNoiseVariance = 0.5f;  // grey levels^2, of both images together, at least
  constexpr int kMinViews = 2;
  constexpr float kFar = 1e30f;
  constexpr int kPerThread = (kEvidencePlanes + Group::kSize - 1) / Group::kSize;
  const PlaneHypothesis& plane = context.planes(col, row);
  const float depth = PlaneDepth(plane, context.rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  if (!(plane.d > 0 && depth > 0)) return 0;
  const uint32_t views = AgreeingViews(context, depth, col, row, group);
  const PlainWindow<kMasked> window = LoadPlainWindow<kMasked>(context, col, row);
  const Vec3f dual = PlaneDual(context, plane);
  float log_ratio[kPerThread] = {};
  int compared[kPerThread] = {};
  int agreeing = 0;
  for (int view = 0; view < context.num_sources; ++view) {
    if ((views >> view & 1u) == 0) continue;
    float unexplained[kPerThread];
    ACMP_UNROLL
    for (int k = 0; k < kPerThread; ++k) {
      const int i = group.Rank() + k * Group::kSize;
      unexplained[k] =
          i < kEvidencePlanes ? UnexplainedVariance(context, window, EvidencePlane(i) * dual, view) : -1.0f;
    }
    const float here = group.FromFirst(unexplained[0]);
    if (here < 0) continue;
    ++agreeing;
    ACMP_UNROLL
    for (int k = 0; k < kPerThread; ++k) {
      if (unexplained[k] < 0) continue;
      ++compared[k];
      log_ratio[k] += logf((unexplained[k] + kNoiseVariance) / (here + kNoiseVariance));
    }
  }
  if (agreeing < kMinViews) return 0;
  float least = kFar;
  ACMP_UNROLL
  for (int k = 0; k < kPerThread; ++k) {
    const bool is_farther = group.Rank() + k * Group::kSize > 0;
    if (!is_farther || 2 * compared[k] < agreeing) continue;  // of what is out of sight there nothing is known
    const float of_all = log_ratio[k] * static_cast<float>(agreeing) / static_cast<float>(compared[k]);
    least = of_all < least ? of_all : least;
  }
  least = group.Least(least);
  const float samples = kMasked ? static_cast<float>(window.count) : kPatchSamples;
  return least < kFar ? 0.5f * samples * least : 0;
}

/// How much the images speak for a pixel's plane against the same plane farther away: the least log-likelihood ratio of
/// it against each EvidencePlane, over the source views whose depths agree with the pixel's (2 px). Noise of equal
/// variance in all samples: n/2 log of the ratio of what is unexplained, summed over the views. About 0 on what has no
/// texture, wherever it is drawn; negative where it fits better farther away. 0 with fewer than two views that agree,
/// and without a plane.
/// @param context with the planes that are asked about and the sources' depths; geometric_max_px above 2
template <class Sampler, class Group = SingleThread>
ACMP_HOST_DEVICE inline float DepthEvidence(const MatchContext<Sampler>& context, int col, int row,
                                            const Group& group = {}) {
  return context.IsNearMasked(col, row, kPatchRadius) ? EvidenceOfWindow<true>(context, col, row, group)
                                                      : EvidenceOfWindow<false>(context, col, row, group);
}

template <class Sampler, class Group = SingleThread>
ACMP_HOST_DEVICE inline float EvidenceOfCell(const MatchContext<Sampler>& context, int cell_col, int cell_row, int size,
                                             const Group& group = {}) {
  return DepthEvidence(context, MiddleOfCell(cell_col, size, context.width),
                       MiddleOfCell(cell_row, size, context.height), group);
}

}  // namespace acmp
