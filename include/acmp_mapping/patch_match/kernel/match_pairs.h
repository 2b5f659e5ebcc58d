#pragma once

#include <cstddef>

#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/propagation.h"

namespace acmp {

constexpr int kMaxHypotheses = kNumRegions + 1;  ///< of one step: the candidates and the pixel's own

/// A window that waits for comparison; image < 0: none.
struct alignas(16) WindowTask {
  PlaneWarp warp;
  int image;  ///< as the sampler calls it
};

/// The largest group; the CPU's has one member.
constexpr int kMaxGroupSize = 8;

/// What the group of one pixel shares. The arrays per source view lie behind it, so that few views need little memory.
struct PixelScratch {
  ReferencePatch patch;
  WindowTask tasks[kMaxGroupSize];
  PlaneHypothesis planes[kMaxHypotheses];
  float cost[kMaxHypotheses];    ///< what is stored of each plane: photometric, or eq. 13
  float energy[kMaxHypotheses];  ///< what is compared: eq. 1, 7 or 13
  float limit[kMaxHypotheses];   ///< weighted sum of view costs from which on a plane cannot win
  int alive[kMaxHypotheses];     ///< planes whose sum is still below their limit
  int count;                     ///< of the planes, or of those alive
  int num_sources;

  ACMP_HOST_DEVICE float* Arrays() { return reinterpret_cast<float*>(this + 1); }
  /// Cost of each plane in each view: [kMaxHypotheses][num_sources].
  ACMP_HOST_DEVICE float* ViewCost(int hypothesis) { return Arrays() + hypothesis * num_sources; }
  ACMP_HOST_DEVICE float* ViewProbability() { return ViewCost(kMaxHypotheses); }
  /// How often each view was drawn.
  ACMP_HOST_DEVICE int* Draws() { return reinterpret_cast<int*>(ViewProbability() + num_sources); }
  /// The views that were drawn at least once, the most often drawn first.
  ACMP_HOST_DEVICE int* DrawnViews() { return Draws() + num_sources; }

  static constexpr int kWordsPerView = kMaxHypotheses + 3;
};

/// Scratch of one pixel on the stack: for groups of one.
struct StackScratch {
  PixelScratch shared;
  float arrays[PixelScratch::kWordsPerView * kMaxSourceViews];
};
static_assert(offsetof(StackScratch, arrays) == sizeof(PixelScratch), "the arrays follow without a gap");

/// The samples of the patch that one thread of a group compares: all, or those of its part of each block, kept in
/// registers.
template <class Group>
struct PatchPart {
  static constexpr bool kWhole = Group::kWindowThreads == 1;
  static_assert(kWhole || Group::kWindowThreads == kBlockSamples, "one thread per sample of a block");

  ACMP_HOST_DEVICE PatchPart(const Group& group, const ReferencePatch& patch) : center(patch.center) {
    if constexpr (!kWhole) {
      ACMP_UNROLL
      for (int block = 0; block < kNumBlocks; ++block) {
        samples[block] = patch.samples[block * kBlockSamples + group.Rank() % kBlockSamples];
      }
    }
  }

  PatchSample samples[kWhole ? 1 : kNumBlocks];
  float center;
};

/// One pixel under comparison, as one thread of its group sees it. The patch has been loaded.
template <class Sampler, class Group>
struct ComparedPixel {
  ACMP_HOST_DEVICE ComparedPixel(const MatchContext<Sampler>& match_context, int pixel_col, int pixel_row,
                                 const Group& pixel_group, PixelScratch* pixel_scratch)
      : context(match_context),
        col(pixel_col),
        row(pixel_row),
        group(pixel_group),
        scratch(pixel_scratch),
        part(pixel_group, pixel_scratch->patch) {}

  const MatchContext<Sampler>& context;
  int col, row;
  Group group;
  PixelScratch* scratch;
  PatchPart<Group> part;
};

/// The sums of a window for each thread of the group, which it hands in (image < 0: none). Subgroups of kWindowThreads
/// take the group's windows in turn, so that neighbouring threads read neighbouring source pixels.
/// @param count how many windows the group has at most: window n is that of the thread n / subgroups of the subgroup
/// n % subgroups
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline WindowSums SumWindows(const ComparedPixel<Sampler, Group>& match, const PlaneWarp& warp,
                                              int image, int count) {
  constexpr int kSubgroups = Group::kSize / Group::kWindowThreads;
  static_assert(Group::kSize <= kMaxGroupSize && kSubgroups <= Group::kWindowThreads,
                "one turn per thread of a subgroup");
  const Group& group = match.group;
  PixelScratch* scratch = match.scratch;
  WindowSums own;
  const int subgroup = group.Rank() / Group::kWindowThreads;
  const int part = group.Rank() % Group::kWindowThreads;
  WindowTask& waiting = scratch->tasks[part * kSubgroups + subgroup];
  waiting.warp = warp;
  waiting.image = image;
  group.Sync();
  for (int turn = 0; turn * kSubgroups + subgroup < count; ++turn) {
    const WindowTask task = scratch->tasks[turn * kSubgroups + subgroup];
    if (task.image < 0) continue;
    WindowSums sums;
    ForEachSampleOfPart(match.context.sampler, task.image, task.warp, part, [&](int block, float gray) {
      MatchingCost::Add(match.part.samples[block], match.part.center, gray, &sums);
    });
    sums = {group.SumOverWindow(sums.ws), group.SumOverWindow(sums.wss), group.SumOverWindow(sums.wrs)};
    if (part == turn) own = sums;
  }
  group.Sync();
  return own;
}

/// Photometric costs of `count` planes of the scratch in `num_views` views: store(plane, view, cost), each pair by one
/// thread. Neighbours mostly have the same view. Groups of one go another way to the same, below.
/// @param plane_of (i): index in the scratch of the i-th of the planes
/// @param view_of (k): the k-th of the views
template <class Sampler, class Group, class PlaneOf, class ViewOf, class Store>
ACMP_HOST_DEVICE inline void MatchPairs(const ComparedPixel<Sampler, Group>& match, int count, int num_views,
                                        const PlaneOf& plane_of, const ViewOf& view_of, const Store& store) {
  constexpr int kSubgroups = Group::kSize / Group::kWindowThreads;
  const MatchContext<Sampler>& context = match.context;
  const ReferencePatch& patch = match.scratch->patch;
  const int total = count * num_views;
  int i = match.group.Rank() % Group::kWindowThreads * kSubgroups + match.group.Rank() / Group::kWindowThreads;
  int k = 0;
  for (int first = 0; first < total; first += Group::kSize, i += Group::kSize) {
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
    const int batch = total - first < Group::kSize ? total - first : Group::kSize;
    const WindowSums sums = SumWindows(match, warp, compare ? context.sampler.ImageOf(view) : -1, batch);
    if (compare) cost = MatchingCost::Of(sums, patch, context.options);
    if (mine) store(plane, view, cost);
  }
  match.group.Sync();
}

/// MatchPairs by one thread alone: each step for all planes of a view before the next, since a step's divisions and
/// roots depend on each other but not on those of the other planes, and a processor works on several at once.
template <class Sampler, class PlaneOf, class ViewOf, class Store>
ACMP_HOST_DEVICE inline void MatchPairs(const ComparedPixel<Sampler, SingleThread>& match, int count, int num_views,
                                        const PlaneOf& plane_of, const ViewOf& view_of, const Store& store) {
  const MatchContext<Sampler>& context = match.context;
  const ReferencePatch& patch = match.scratch->patch;
  Vec3f duals[kMaxHypotheses];
  float cost[kMaxHypotheses];
  PlaneWarp warps[kMaxHypotheses];  // of the windows that have to be compared
  int compared[kMaxHypotheses];     // whose they are
  WindowSums sums[kMaxHypotheses];
  for (int i = 0; i < count; ++i) duals[i] = PlaneDual(context, match.scratch->planes[plane_of(i)]);
  for (int k = 0; k < num_views; ++k) {
    const int view = view_of(k);
    int windows = 0;
    for (int i = 0; i < count; ++i) {
      compared[windows] = i;
      windows += PrepareWindow(context, patch, duals[i], match.col, match.row, view, &warps[windows], &cost[i]) ? 1 : 0;
    }
    SumWindowsOfView(context.sampler, view, warps, windows, patch, sums);
    for (int i = 0; i < windows; ++i) cost[compared[i]] = MatchingCost::Of(sums[i], patch, context.options);
    for (int i = 0; i < count; ++i) store(plane_of(i), view, cost[i]);
  }
}

}  // namespace acmp
