#pragma once

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"
#include "acmp_mapping/patch_match/kernel/team.h"

namespace acmp {

/// Of the thresholded likelihood: a view with enough costs so bad shows something else, and is not drawn.
constexpr float kBadCost = 1.2f;

/// How many good or bad costs decide: three of all eight regions' (design note 5), two of half of them.
ACMP_HOST_DEVICE inline int DecisiveCosts(const RegionRange& regions) { return regions.count == kNumRegions ? 3 : 2; }

/// Whether these costs alone reject the view, whatever the others are.
ACMP_HOST_DEVICE inline bool IsViewRejected(const float* costs, int stride, int count, int decisive,
                                            const PatchMatchOptions& options) {
  if (options.view_weighting == ViewWeighting::kPaper) return false;
  int bad = 0;
  for (int i = 0; i < count; ++i) bad += costs[i * stride] > kBadCost ? 1 : 0;
  return bad >= decisive;
}

/// P(X_j | Z_j, theta) of one view from its costs over the hypotheses. kThresholded: mean likelihood of the good ones
/// where `decisive` or more are good and fewer bad, a floor where they are neither; kPaper: the plain sum.
ACMP_HOST_DEVICE inline float ViewLikelihood(const float* costs, int stride, int count, int iteration, int decisive,
                                             const PatchMatchOptions& options) {
  const float inv_sigma = 0.5f / (options.sigma_view * options.sigma_view);
  if (options.view_weighting == ViewWeighting::kPaper) {
    float sum = 0;
    for (int i = 0; i < count; ++i) sum += expf(-costs[i * stride] * costs[i * stride] * inv_sigma);
    return sum;
  }
  const float good_threshold = 0.8f * expf(static_cast<float>(iteration * iteration) / -90.0f);
  int good = 0, bad = 0;
  float sum = 0;
  for (int i = 0; i < count; ++i) {
    // The analyser does not see that the caller has filled the first `count` costs of each view.
    const float cost = costs[i * stride];  // NOLINT(clang-analyzer-core.uninitialized.Assign)
    if (cost < good_threshold) {
      sum += expf(-cost * cost * inv_sigma);
      ++good;
    } else if (cost > kBadCost) {
      ++bad;
    }
  }
  if (bad >= decisive) return 0;
  if (good >= decisive) return sum / static_cast<float>(good);
  return expf(good_threshold * good_threshold / -0.32f);
}

ACMP_HOST_DEVICE inline uint32_t AllViews(int num_sources) { return 0xffffffffu >> (32 - num_sources); }

/// P(Z_j | Z_n): sum over the four neighbours of eta where the neighbour uses the view, 1 - eta where it does not.
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

/// The views in which candidates are worth comparing, as a mask: those that at least candidate_view_votes of the pixel
/// and its four neighbours use, or all where there is none.
template <class Sampler>
ACMP_HOST_DEVICE inline uint32_t CredibleViews(const MatchContext<Sampler>& context, int col, int row) {
  constexpr int kMaxVotes = 5;
  const int dx[kMaxVotes] = {0, 0, 0, -1, 1};
  const int dy[kMaxVotes] = {0, -1, 1, 0, 0};
  uint32_t with_votes[kMaxVotes] = {};  // [n]: views with more than n votes
  for (int i = 0; i < kMaxVotes; ++i) {
    if (!context.Contains(col + dx[i], row + dy[i])) continue;
    const uint32_t used = context.selected_views(col + dx[i], row + dy[i]);
    ACMP_UNROLL
    for (int n = kMaxVotes - 1; n > 0; --n) with_votes[n] |= with_votes[n - 1] & used;
    with_votes[0] |= used;
  }
  uint32_t credible = 0;
  ACMP_UNROLL
  for (int n = 0; n < kMaxVotes; ++n) {
    if (n + 1 == context.options.candidate_view_votes) credible = with_votes[n];
  }
  return credible != 0 ? credible : AllViews(context.num_sources);
}

/// Monte-Carlo draws from probabilities that need not be normalised: adds one to `counts[j]` for every draw of view j,
/// and the counts become the integer weights w_j of eq. 1. False, with nothing drawn, where all probabilities are zero.
/// All of the team see the counts when it returns.
template <class Team>
ACMP_HOST_DEVICE inline bool DrawViews(const float* probability, int num_views, int draws, const Team& team,
                                       RandomStream* random, int* counts) {
  float total = 0;
  int last = -1;
  for (int j = 0; j < num_views; ++j) {
    total += probability[j];
    if (probability[j] > 0) last = j;
  }
  if (last < 0) return false;
  ForEach(team, draws, [&](int k) {
    RandomStream own = *random;
    own.Skip(static_cast<uint32_t>(k));
    float rest = own.NextUniform() * total;
    int view = 0;
    while (view < last && !(rest < probability[view])) rest -= probability[view++];
    // Where the product above and a difference fuse, `rest` can come out below 0 and end the search on a view of
    // probability zero: never draw one.
    team.Increment(counts + (probability[view] > 0 ? view : last));
  });
  random->Skip(static_cast<uint32_t>(draws));
  team.Sync();
  return true;
}

/// Lists the views of a mask in `list`, for the whole team. Returns how many.
template <class Team>
ACMP_HOST_DEVICE inline int ListViews(uint32_t mask, int num_views, const Team& team, int* list) {
  ForEach(team, num_views, [&](int j) {
    if ((mask >> j & 1u) != 0) list[CountBits(mask & ~(0xffffffffu << j))] = j;
  });
  team.Sync();
  return CountBits(mask);
}

/// The views with a positive count, as a mask, and listed in `list` from the largest count to the smallest; for the
/// whole team.
template <class Team>
ACMP_HOST_DEVICE inline uint32_t ListDrawnViews(const int* counts, int num_views, const Team& team, int* list) {
  uint32_t mask = 0;
  for (int j = 0; j < num_views; ++j) mask |= (counts[j] > 0 ? 1u : 0u) << j;
  ForEach(team, num_views, [&](int j) {
    const int count = counts[j];
    if (count == 0) return;
    int place = 0;
    for (int other = 0; other < num_views; ++other) {
      place += counts[other] > count || (counts[other] == count && other < j) ? 1 : 0;
    }
    list[place] = j;
  });
  team.Sync();
  return mask;
}

}  // namespace acmp
