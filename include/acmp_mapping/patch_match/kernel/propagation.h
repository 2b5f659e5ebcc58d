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

constexpr int kDirections = 4;                ///< up, down, left, right
constexpr int kNumRegions = 2 * kDirections;  ///< a V-shaped near region and a far strip in each
constexpr int kNearRegionSize = 7;
constexpr int kFarRegionSize = 11;

ACMP_HOST_DEVICE constexpr int RegionSize(bool is_far) { return is_far ? kFarRegionSize : kNearRegionSize; }

/// Where member `member` of a region of the adaptive checkerboard (ACMH, CVPR 2019) lies: steps in the region's
/// direction, and across it: (1, 0), (2, +-1), (3, +-2), (4, +-3) of a near V, (3, 0), (5, 0) .. (23, 0) of a far
/// strip. Their sums are odd: the other colour.
ACMP_HOST_DEVICE constexpr int StepsAcross(bool is_far, int member) {
  return is_far ? 0 : member % 2 == 1 ? -(member + 1) / 2 : (member + 1) / 2;
}
ACMP_HOST_DEVICE constexpr int StepsAlong(bool is_far, int member) {
  return is_far ? 3 + 2 * member : (member + 1) / 2 + 1;
}
ACMP_HOST_DEVICE constexpr int RegionReach(bool is_far) { return StepsAlong(is_far, RegionSize(is_far) - 1); }

/// Offset of member `member` of region `region`: 0-3 are the near Vs up, down, left, right; 4-7 the far strips in the
/// same order.
ACMP_HOST_DEVICE inline void RegionOffset(int region, int member, int* dx, int* dy) {
  const bool is_far = region >= kDirections;
  const int direction = region % kDirections, across = StepsAcross(is_far, member);
  const int along = direction % 2 == 0 ? -StepsAlong(is_far, member) : StepsAlong(is_far, member);
  *dx = direction < 2 ? across : along;
  *dy = direction < 2 ? along : across;
}

/// The region's member with the smallest stored cost, or -1 when the whole region lies outside the image. Ties go to
/// the nearer member.
template <class Sampler>
ACMP_HOST_DEVICE inline int BestOfRegion(const MatchContext<Sampler>& context, int col, int row, int region) {
  int best = -1;
  float best_cost = 0;
  for (int member = 0; member < RegionSize(region >= kDirections); ++member) {
    int dx, dy;
    RegionOffset(region, member, &dx, &dy);
    if (!context.Contains(col + dx, row + dy)) continue;
    const float cost = context.cost(col + dx, row + dy);
    if (best < 0 || cost < best_cost) {
      best = member;
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
  const bool far = ((static_cast<uint32_t>(col / 2 + row / 2) + turn) & 1u) != 0;
  return {far ? kDirections : 0, kDirections};
}

/// What a region hands over: its best member's plane (`member`: BestOfRegion); absent where that does not meet the
/// pixel's ray within the depth range.
template <class Sampler>
ACMP_HOST_DEVICE inline PlaneHypothesis CandidateOf(const MatchContext<Sampler>& context, int col, int row,
                                                    const Vec3f& ray, int region, int member) {
  if (member < 0) return {};
  int dx, dy;
  RegionOffset(region, member, &dx, &dy);
  const PlaneHypothesis plane = context.planes(col + dx, row + dy);
  return context.InRange(PlaneDepth(plane, ray)) ? plane : PlaneHypothesis{};
}

/// Hypotheses from the other colour, one per region that has one, into `candidates`. Returns how many; all of the group
/// see them then. Samplers may overload it with something faster.
/// @param count memory that the group shares
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline int CollectCandidates(const MatchContext<Sampler>& context, int col, int row, const Vec3f& ray,
                                              const RegionRange& regions, const Group& group,
                                              PlaneHypothesis* candidates, int* count) {
  ForEach(group, regions.count, [&](int i) {
    const int region = regions.first + i;
    candidates[i] = CandidateOf(context, col, row, ray, region, BestOfRegion(context, col, row, region));
  });
  return RemoveAbsent(group, regions.count, candidates, count);
}

}  // namespace acmp
