#pragma once

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/common/thread_group.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"
#include "acmp_mapping/patch_match/kernel/rate_plane.h"

namespace acmp {

/// tau_1 of ACMH: a view with enough costs so bad shows something else, and does not count.
constexpr float kBadCost = 1.2f;

/// n_1 + 1 and n_2 of ACMH: so many good costs select a view, and so many bad ones reject it.
constexpr int kDecisiveCosts = 3;

/// The same of ours: two of four regions' costs.
ACMP_HOST_DEVICE inline int DecisiveCosts(const RegionRange& regions) {
  return regions.count == kNumRegions ? kDecisiveCosts : 2;
}

/// tau(t) of ACMH's eq. 2: costs below are good.
ACMP_HOST_DEVICE inline float GoodCost(int iteration) {
  return 0.8f * expf(static_cast<float>(iteration * iteration) / -90.0f);
}

/// P(X_j | Z_j, theta) of ACMP: the sum of eq. 9 over all hypotheses.
ACMP_HOST_DEVICE inline float SumOfLikelihoods(const float* costs, int stride, int count,
                                               const PatchMatchOptions& options) {
  const float inv_sigma = 0.5f / (options.sigma_view * options.sigma_view);
  float sum = 0;
  for (int i = 0; i < count; ++i) sum += expf(-costs[i * stride] * costs[i * stride] * inv_sigma);
  return sum;
}

/// How costs become w(I_j) of ACMH.
struct ConfidenceRule {
  float good;       ///< costs below are good
  int decisive;     ///< so many good costs select a view, and so many bad ones reject it
  float undecided;  ///< the confidence in a view that they do neither to
  float inv_sigma;  ///< 1 / (2 beta^2)
};

/// In ours an undecided view has the confidence of a cost just good enough with a beta of 0.4, in ACMH none.
template <Method kMethod>
ACMP_HOST_DEVICE inline ConfidenceRule MakeConfidenceRule(int iteration, int decisive,
                                                          const PatchMatchOptions& options) {
  const float good = GoodCost(iteration);
  return {good, decisive, kMethod == Method::kOurs ? expf(good * good / -0.32f) : 0.0f,
          0.5f / (options.sigma_view * options.sigma_view)};
}

/// w(I_j) of ACMH, from a view's costs over the propagated hypotheses: the mean confidence exp(-m^2 / (2 beta^2)) of
/// the good ones where enough are good and few bad.
ACMP_HOST_DEVICE inline float MeanConfidence(const float* costs, int stride, int count, const ConfidenceRule& rule) {
  int good = 0, bad = 0;
  float sum = 0;
  for (int i = 0; i < count; ++i) {
    // The analyser does not see that the caller has filled the first `count` costs of each view.
    const float cost = costs[i * stride];  // NOLINT(clang-analyzer-core.uninitialized.Assign)
    if (cost < rule.good) {
      sum += expf(-cost * cost * rule.inv_sigma);
      ++good;
    } else if (cost > kBadCost) {
      ++bad;
    }
  }
  if (bad >= rule.decisive) return 0;
  return good >= rule.decisive ? sum / static_cast<float>(good) : rule.undecided;
}

/// MeanConfidence of each of the views in a mask, of the others 0; each by the thread that ForEach gives the view to.
/// Samplers may overload it with something faster that differs in rounding only.
/// @param costs of `count` hypotheses, [count][num_views]
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline void FindConfidences(const Sampler&, const Group& group, const float* costs, uint32_t views,
                                             int num_views, int count, const ConfidenceRule& rule, float* confidence) {
  ForEach(group, num_views, [&](int view) {
    confidence[view] = (views >> view & 1u) != 0 ? MeanConfidence(costs + view, num_views, count, rule) : 0.0f;
  });
}

/// w'(I_j) of ACMH: the view that weighed most in the iteration before counts twice, and a little where it would not
/// count at all.
ACMP_HOST_DEVICE inline float WeightWithMemory(float confidence, bool weighed_most) {
  constexpr float kLeftOver = 0.2f;
  if (!weighed_most) return confidence;
  return confidence > 0 ? 2.0f * confidence : kLeftOver;
}

ACMP_HOST_DEVICE inline uint32_t AllViews(int num_sources) { return 0xffffffffu >> (32 - num_sources); }

/// P(Z_j | Z_n) of ACMP: the sum of eq. 10 over the four neighbours, eta where the neighbour uses the view, 1 - eta
/// where it does not.
template <class Sampler>
ACMP_HOST_DEVICE inline float ViewSmoothness(const MatchContext<Sampler>& context, int col, int row, int view) {
  const float eta = context.options.view_smoothness;
  const int dx[4] = {0, 0, -1, 1};
  const int dy[4] = {-1, 1, 0, 0};
  float sum = 0;
  for (int i = 0; i < 4; ++i) {
    if (!context.Contains(col + dx[i], row + dy[i])) continue;
    const bool used = (context.selected_views(col + dx[i], row + dy[i]) >> view) & 1u;
    sum += used ? eta : 1.0f - eta;
  }
  return sum;
}

/// The views in which candidates are worth comparing, as a mask: those that at least min_neighbours_per_view of the
/// pixel and its four neighbours use, or all where there is none.
template <class Sampler>
ACMP_HOST_DEVICE inline uint32_t ViewsOfNeighbours(const MatchContext<Sampler>& context, int col, int row) {
  constexpr int kMaxUsers = 5;
  const int dx[kMaxUsers] = {0, 0, 0, -1, 1};
  const int dy[kMaxUsers] = {0, -1, 1, 0, 0};
  uint32_t used_by[kMaxUsers] = {};  // [n]: views with more than n users
  for (int i = 0; i < kMaxUsers; ++i) {
    if (!context.Contains(col + dx[i], row + dy[i])) continue;
    const uint32_t used = context.selected_views(col + dx[i], row + dy[i]);
    ACMP_UNROLL
    for (int n = kMaxUsers - 1; n > 0; --n) used_by[n] |= used_by[n - 1] & used;
    used_by[0] |= used;
  }
  uint32_t enough = 0;
  ACMP_UNROLL
  for (int n = 0; n < kMaxUsers; ++n) {
    if (n + 1 == context.options.min_neighbours_per_view) enough = used_by[n];
  }
  return enough != 0 ? enough : AllViews(context.num_sources);
}

/// Monte-Carlo draws from probabilities that need not be normalised: adds one to `counts[j]` for every draw of view j,
/// and the counts become the integer weights w_j of eq. 1. False, with nothing drawn, where all probabilities are zero.
/// All of the group see the counts when it returns.
template <class Group>
ACMP_HOST_DEVICE inline bool DrawViews(const float* probability, int num_views, int draws, const Group& group,
                                       RandomStream* random, int* counts) {
  float total = 0;
  int last = -1;
  for (int j = 0; j < num_views; ++j) {
    total += probability[j];
    if (probability[j] > 0) last = j;
  }
  if (last < 0) return false;
  ForEach(group, draws, [&](int k) {
    RandomStream own = *random;
    own.Skip(static_cast<uint32_t>(k));
    float rest = own.NextUniform() * total;
    int view = 0;
    while (view < last && !(rest < probability[view])) rest -= probability[view++];
    // Where the product above and a difference fuse, `rest` can come out below 0 and end the search on a view of
    // probability zero: never draw one.
    group.Increment(counts + (probability[view] > 0 ? view : last));
  });
  random->Skip(static_cast<uint32_t>(draws));
  group.Sync();
  return true;
}

/// Lists the views of a mask in `list`, for the whole group. Returns how many.
template <class Group>
ACMP_HOST_DEVICE inline int ListViews(uint32_t mask, int num_views, const Group& group, int* list) {
  ForEach(group, num_views, [&](int j) {
    if ((mask >> j & 1u) != 0) list[CountBits(mask & ~(0xffffffffu << j))] = j;
  });
  group.Sync();
  return CountBits(mask);
}

/// The views with a positive weight, as a mask, and listed in `list` from the largest weight to the smallest; for the
/// whole group.
template <class Weight, class Group>
ACMP_HOST_DEVICE inline uint32_t ListWeighedViews(const Weight* weights, int num_views, const Group& group, int* list) {
  uint32_t mask = 0;
  for (int j = 0; j < num_views; ++j) mask |= (weights[j] > 0 ? 1u : 0u) << j;
  ForEach(group, num_views, [&](int j) {
    const Weight weight = weights[j];
    if (!(weight > 0)) return;
    int place = 0;
    for (int other = 0; other < num_views; ++other) {
      place += weights[other] > weight || (weights[other] == weight && other < j) ? 1 : 0;
    }
    list[place] = j;
  });
  group.Sync();
  return mask;
}

/// Draws the view weights from the candidates' costs in `views`. Returns the drawn views as a mask: 0 where no view
/// counts.
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline uint32_t WeighViews(const PixelUpdate<Sampler, Group, kMethod>& pixel, uint32_t views,
                                            int count, int iteration, RandomStream* random) {
  PixelScratch& scratch = *pixel.scratch;
  const MatchContext<Sampler>& context = pixel.context;
  float* likelihoods = scratch.ViewProbability();
  if constexpr (kMethod != Method::kAcmp) {
    const ConfidenceRule rule = MakeConfidenceRule<kMethod>(iteration, DecisiveCosts(pixel.regions), context.options);
    FindConfidences(context.sampler, pixel.group, scratch.ViewCost(0), views, context.num_sources, count - 1, rule,
                    likelihoods);
  }
  ForEach(pixel.group, context.num_sources, [&](int view) {
    float likelihood = 0;
    if constexpr (kMethod == Method::kAcmp) {
      likelihood = SumOfLikelihoods(scratch.ViewCost(0) + view, context.num_sources, count, context.options);
    } else {
      likelihood = likelihoods[view];
    }
    likelihoods[view] = likelihood > 0 ? likelihood * ViewSmoothness(context, pixel.col, pixel.row, view) : 0;
    scratch.Draws()[view] = 0;
  });
  pixel.group.Sync();
  if (!DrawViews(scratch.ViewProbability(), context.num_sources, context.options.view_draws, pixel.group, random,
                 scratch.Draws())) {
    return 0;
  }
  return ListWeighedViews(scratch.Draws(), context.num_sources, pixel.group, scratch.DrawnViews());
}

/// ACMH's view weights: no random numbers, and the memory of the iteration before in place of the neighbours' views.
/// Returns the views with a positive weight as a mask.
/// @param weighed_most the view that did so before, as a mask; 0: none
template <class Sampler, class Group, Method kMethod>
ACMP_HOST_DEVICE inline uint32_t WeighViewsWithMemory(const PixelUpdate<Sampler, Group, kMethod>& pixel,
                                                      uint32_t weighed_most, int count, int iteration) {
  PixelScratch& scratch = *pixel.scratch;
  const int num_sources = pixel.context.num_sources;
  const ConfidenceRule rule = MakeConfidenceRule<kMethod>(iteration, kDecisiveCosts, pixel.context.options);
  ForEach(pixel.group, num_sources, [&](int view) {
    const float confidence = MeanConfidence(scratch.ViewCost(0) + view, num_sources, count - 1, rule);
    scratch.ViewProbability()[view] = WeightWithMemory(confidence, (weighed_most >> view & 1u) != 0);
  });
  pixel.group.Sync();
  return ListWeighedViews(scratch.ViewProbability(), num_sources, pixel.group, scratch.DrawnViews());
}

}  // namespace acmp
