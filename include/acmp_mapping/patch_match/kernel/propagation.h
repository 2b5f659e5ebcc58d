#pragma once

#include "acmp_mapping/common/thread_group.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// Closes the gaps that absent planes (d = 0) leave in a list that the group shares. Returns how many are left.
template <class Group>
ACMP_HOST_DEVICE inline int RemoveAbsent(const Group& group, int size, PlaneHypothesis* planes, int* count) {
  group.Sync();
  if (group.Rank() == 0) {
    int present = 0;
    for (int i = 0; i < size; ++i) {
      const PlaneHypothesis plane = planes[i];
      if (plane.d > 0) planes[present++] = plane;
    }
    *count = present;
  }
  group.Sync();
  return *count;
}

constexpr int kNumRegions = 8;  ///< four V-shaped near regions, four far strips
constexpr int kNearRegionSize = 7;
constexpr int kFarRegionSize = 11;

/// Offset of member `member` of region `region` of the adaptive checkerboard (ACMH, CVPR 2019): regions 0-3 are the
/// near Vs up, down, left, right; 4-7 the far strips in the same order. dx + dy is odd for all: the other colour.
ACMP_HOST_DEVICE inline void RegionOffset(int region, int member, int* dx, int* dy) {
  int along, across;
  if (region < 4) {
    // (0,1), (+-1,2), (+-2,3), (+-3,4)
    across = (member + 1) / 2;
    along = across + 1;
    if (member % 2 == 1) across = -across;
  } else {
    across = 0;
    along = 3 + 2 * member;
  }
  const int direction = region % 4;
  if (direction == 0 || direction == 2) along = -along;
  *dx = direction < 2 ? across : along;
  *dy = direction < 2 ? along : across;
}

ACMP_HOST_DEVICE inline int RegionSize(int region) { return region < 4 ? kNearRegionSize : kFarRegionSize; }

/// Linear index of the region's member with the smallest stored cost, or -1 when the whole region lies outside the
/// image. Ties go to the nearer member.
template <class Sampler>
ACMP_HOST_DEVICE inline int BestOfRegion(const MatchContext<Sampler>& context, int col, int row, int region) {
  int best = -1;
  float best_cost = 0;
  for (int member = 0; member < RegionSize(region); ++member) {
    int dx, dy;
    RegionOffset(region, member, &dx, &dy);
    if (!context.Contains(col + dx, row + dy)) continue;
    const float cost = context.cost(col + dx, row + dy);
    if (best < 0 || cost < best_cost) {
      best = (row + dy) * context.width + col + dx;
      best_cost = cost;
    }
  }
  return best;
}

/// Regions that a pixel takes candidates from.
struct RegionRange {
  int first, count;
};

constexpr RegionRange kAllRegions = {0, kNumRegions};

/// The four near or the four far ones: neighbouring blocks of 2 x 2 px take different ones, and a block those that it
/// did not take a turn ago.
ACMP_HOST_DEVICE inline RegionRange AlternatingRegions(int col, int row, uint32_t turn) {
  constexpr int kHalf = kNumRegions / 2;
  const bool far = ((static_cast<uint32_t>(col / 2 + row / 2) + turn) & 1u) != 0;
  return {far ? kHalf : 0, kHalf};
}

/// Hypotheses from the other colour, one per region, into `candidates`. Absent: outside the image, or the
/// plane does not meet this pixel's ray within the depth range. Returns how many; all of the group see them then.
/// @param count memory that the group shares
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline int CollectCandidates(const MatchContext<Sampler>& context, int col, int row, const Vec3f& ray,
                                              const RegionRange& regions, const Group& group,
                                              PlaneHypothesis* candidates, int* count) {
  ForEach(group, regions.count, [&](int i) {
    const int index = BestOfRegion(context, col, row, regions.first + i);
    PlaneHypothesis plane;
    if (index >= 0) plane = context.planes(index % context.width, index / context.width);
    candidates[i] = index >= 0 && context.InRange(PlaneDepth(plane, ray)) ? plane : PlaneHypothesis{};
  });
  return RemoveAbsent(group, regions.count, candidates, count);
}

}  // namespace acmp
