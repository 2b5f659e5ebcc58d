#pragma once

#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/pixel_scratch.h"

namespace acmp {

/// The samples of the patch that one thread of a team compares: all, or those of its part of each block, kept in
/// registers.
template <class Team>
struct PatchPart {
  static constexpr bool kWhole = Team::kWindowThreads == 1;
  static_assert(kWhole || Team::kWindowThreads == kBlockSamples, "one thread per sample of a block");

  ACMP_HOST_DEVICE PatchPart(const Team& team, const ReferencePatch& patch) : center(patch.center) {
    if constexpr (!kWhole) {
      ACMP_UNROLL
      for (int block = 0; block < kNumBlocks; ++block) {
        samples[block] = patch.samples[block * kBlockSamples + team.Rank() % kBlockSamples];
      }
    }
  }

  PatchSample samples[kWhole ? 1 : kNumBlocks];
  float center;
};

/// One pixel under comparison, as one thread of its team sees it. The patch has been loaded.
template <class Sampler, class Team>
struct PixelMatch {
  ACMP_HOST_DEVICE PixelMatch(const MatchContext<Sampler>& match_context, int pixel_col, int pixel_row,
                              const Team& pixel_team, PixelScratch* pixel_scratch)
      : context(match_context),
        col(pixel_col),
        row(pixel_row),
        team(pixel_team),
        scratch(pixel_scratch),
        part(pixel_team, pixel_scratch->patch) {}

  const MatchContext<Sampler>& context;
  int col, row;
  Team team;
  PixelScratch* scratch;
  PatchPart<Team> part;
};

/// The sums of a window for each thread of the team, which it hands in (image < 0: none). Groups of kWindowThreads take
/// the team's windows in turn, so that neighbouring threads read neighbouring source pixels.
/// @param count how many windows the team has at most: window n is that of the thread n / groups of group n % groups
template <class Sampler, class Team>
ACMP_HOST_DEVICE inline WindowSums SumWindows(const PixelMatch<Sampler, Team>& match, const PlaneWarp& warp, int image,
                                              int count) {
  constexpr int kGroups = Team::kSize / Team::kWindowThreads;
  static_assert(Team::kSize <= kMaxTeamSize && kGroups <= Team::kWindowThreads, "one turn per thread of a group");
  const Team& team = match.team;
  PixelScratch* scratch = match.scratch;
  WindowSums own;
  const int group = team.Rank() / Team::kWindowThreads;
  const int part = team.Rank() % Team::kWindowThreads;
  WindowTask& waiting = scratch->tasks[part * kGroups + group];
  waiting.warp = warp;
  waiting.image = image;
  team.Sync();
  for (int turn = 0; turn * kGroups + group < count; ++turn) {
    const WindowTask task = scratch->tasks[turn * kGroups + group];
    if (task.image < 0) continue;
    WindowSums sums;
    ForEachSampleOfPart(match.context.sampler, task.image, task.warp, part, [&](int block, float gray) {
      AddSample(match.part.samples[block], match.part.center, gray, &sums);
    });
    sums = {team.SumOverWindow(sums.ws), team.SumOverWindow(sums.wss), team.SumOverWindow(sums.wrs)};
    if (part == turn) own = sums;
  }
  team.Sync();
  return own;
}

/// Photometric costs of `count` planes of the scratch in `num_views` views: store(plane, view, cost), each pair by one
/// thread. Neighbours mostly have the same view. match_alone.h has another way to the same for teams of one.
/// @param plane_of (i): index in the scratch of the i-th of the planes
/// @param view_of (k): the k-th of the views
template <class Sampler, class Team, class PlaneOf, class ViewOf, class Store>
ACMP_HOST_DEVICE inline void MatchPairs(const PixelMatch<Sampler, Team>& match, int count, int num_views,
                                        const PlaneOf& plane_of, const ViewOf& view_of, const Store& store) {
  constexpr int kGroups = Team::kSize / Team::kWindowThreads;
  const MatchContext<Sampler>& context = match.context;
  const ReferencePatch& patch = match.scratch->patch;
  const int total = count * num_views;
  int i = match.team.Rank() % Team::kWindowThreads * kGroups + match.team.Rank() / Team::kWindowThreads;
  int k = 0;
  for (int first = 0; first < total; first += Team::kSize, i += Team::kSize) {
    for (; i >= count; i -= count) ++k;
    const bool mine = k < num_views;
    bool compare = false;
    int plane = 0, view = -1;
    float cost = kWorstCost;
    PlaneWarp warp = {};
    if (mine) {
      plane = plane_of(i);
      view = view_of(k);
      const Vec3f dual = PlaneDual(context, match.scratch->planes[plane]);
      compare = PrepareWindow(context, patch, dual, match.col, match.row, view, &warp, &cost);
    }
    const int batch = total - first < Team::kSize ? total - first : Team::kSize;
    const WindowSums sums = SumWindows(match, warp, compare ? context.sampler.ImageOf(view) : -1, batch);
    if (compare) cost = NccCost(context, patch, sums);
    if (mine) store(plane, view, cost);
  }
  match.team.Sync();
}

}  // namespace acmp
