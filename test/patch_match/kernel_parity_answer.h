#pragma once

#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/view_weights.h"
#include "kernel_parity.h"
#include "support/absolute_difference.h"

namespace acmp {

/// Draws among views whose probabilities are random or zero.
ACMP_HOST_DEVICE inline void AnswerDraws(RandomStream* random, ParityAnswer* answer) {
  constexpr int kViews = 8;
  float probability[kMaxSourceViews];
  uint32_t possible = 0;
  for (int j = 0; j < kViews; ++j) {
    const float value = random->NextUniform(-1.0f, 1.0f);
    probability[j] = value > 0 ? value : 0.0f;
    if (value > 0) possible |= 1u << j;
  }
  int counts[kViews] = {};
  int list[kViews];
  const SingleThread group;
  DrawViews(probability, kViews, 255, group, random, counts);
  answer->drawn_views = ListWeighedViews(counts, kViews, group, list);
  answer->impossible_views = answer->drawn_views & ~possible;
  for (const int count : counts) answer->draws += count;
}

/// All of an answer but texture_cost, compiled for both devices.
/// @param other the same as the context, but for the cost
ACMP_HOST_DEVICE inline ParityAnswer Answer(const MatchContext<BilinearSampler>& context,
                                            const MatchContext<AbsoluteDifferenceSampler>& other,
                                            const ParityQuery& query) {
  ParityAnswer answer = {};
  const Vec3f ray = context.rays.Ray(static_cast<float>(query.col), static_cast<float>(query.row));
  ReferencePatch patch;
  LoadReferencePatch(context, query.col, query.row, context.options.sigma_color, SingleThread(), &patch);
  answer.bilinear_cost =
      PhotometricCost(context, patch, PlaneDual(context, query.plane), query.col, query.row, query.view);
  answer.other_cost = PhotometricCost(other, patch, PlaneDual(other, query.plane), query.col, query.row, query.view);
  const float depth = PlaneDepth(query.plane, ray);
  answer.geometric_error = GeometricError(context, depth, query.col, query.row, query.view);
  const auto pixel = static_cast<uint32_t>(query.row * context.width + query.col);
  RandomStream random(context.options.seed, pixel, static_cast<uint32_t>(query.view));
  AnswerDraws(&random, &answer);
  return answer;
}

}  // namespace acmp
