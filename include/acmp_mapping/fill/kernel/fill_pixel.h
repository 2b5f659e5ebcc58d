#pragma once

#include "acmp_mapping/fill/kernel/fill_grid.h"

namespace acmp {

/// Planes that could be extended to a pixel, by direction. Every index is known to the compiler, so that a GPU thread
/// has them in registers.
struct ExtendedPlanes {
  float inverse_depth[kNumDirections];  ///< at the pixel
  float weight[kNumDirections];         ///< 0: none
};

/// The nearest seeds' planes that meet the pixel's ray within the depth range. Nearer seeds weigh more; the farther
/// even the nearest is, the less the difference counts.
ACMP_HOST_DEVICE inline void FindExtendedPlanes(const FillContext& context, const NearestSeeds& nearest, int col,
                                                int row, ExtendedPlanes* planes) {
  constexpr float kReach = 6.0f;        // cells in which the weight falls by e
  constexpr float kReachGrowth = 0.6f;  // cells more per cell to the nearest
  constexpr float kFar = 1e30f;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const float inv_cell = 1.0f / static_cast<float>(context.cell_size);
  float distance[kNumDirections];  // from the seed, cells
  float least = kFar;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) {
    distance[i] = kFar;
    planes->inverse_depth[i] = 0;
    const int cell = nearest.cell[i];
    if (cell < 0) continue;
    const SeedCell& seed = context.fitted.data[cell];
    const float inverse_depth = Dot(seed.inverse_plane, ray);
    if (!(inverse_depth * context.depth_min <= 1 && inverse_depth * context.depth_max >= 1)) continue;
    const float dx = static_cast<float>(seed.col - col), dy = static_cast<float>(seed.row - row);
    planes->inverse_depth[i] = inverse_depth;
    distance[i] = sqrtf(dx * dx + dy * dy) * inv_cell;
    least = Smaller(distance[i], least);
  }
  const float inv_reach = 1.0f / (kReach + kReachGrowth * least);
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) {
    planes->weight[i] = distance[i] < kFar ? expf((least - distance[i]) * inv_reach) : 0;
  }
}

/// Takes the weight from planes that differ from the pixel's own depth by more than one in 25. What a view nearly
/// confirms is off by less than that as a rule, however noisy it is; a plane extended from elsewhere may be of another
/// surface.
ACMP_HOST_DEVICE inline void KeepPlanesNear(float depth, ExtendedPlanes* planes) {
  constexpr float kSameSurface = 0.04f;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) {
    const bool is_near = fabsf(planes->inverse_depth[i] * depth - 1) < kSameSurface;
    planes->weight[i] = is_near ? planes->weight[i] : 0;
  }
}

/// Direction of the weighted quantile: the least inverse depth up to which lies this share of the weight or more, half
/// of it for the median. -1: no plane has a weight.
ACMP_HOST_DEVICE inline int WeightedQuantile(const ExtendedPlanes& planes, float share) {
  float total = 0;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) total += planes.weight[i];
  int quantile = -1;
  float least = 0;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) {
    const float inverse_depth = planes.inverse_depth[i];
    float up_to = 0;  // added in the same order: of the greatest it is the total
    ACMP_UNROLL
    for (int j = 0; j < kNumDirections; ++j) {
      up_to += planes.inverse_depth[j] <= inverse_depth ? planes.weight[j] : 0;
    }
    const bool is_quantile = planes.weight[i] > 0 && up_to >= share * total && (quantile < 0 || inverse_depth < least);
    quantile = is_quantile ? i : quantile;
    least = is_quantile ? inverse_depth : least;
  }
  return quantile;
}

/// Whether a pixel has this cost because its plane was measured elsewhere: it was filled, or filtered.
ACMP_HOST_DEVICE inline bool IsFilled(float cost) { return cost >= kUnverifiedCost; }

/// The share of the planes' weight behind the one that a pixel takes. As one of several alternatives: a plane in front
/// of most or one behind most, by blocks of 2 x 2 px. What is blank lies behind what is around it more often than in
/// front.
ACMP_HOST_DEVICE inline float DepthQuantile(const FillContext& context, int col, int row) {
  constexpr float kMedian = 0.5f, kNearer = 0.65f, kFarther = 0.2f;
  if (!context.near_and_far) return kMedian;
  return (col / 2 + row / 2) % 2 == 0 ? kNearer : kFarther;
}

/// A pixel that too few views confirm takes the plane that is the median of its surroundings', or an alternative, near
/// its own depth where a view nearly confirms that. Where no view confirmed it, it is an unconfirmed pixel, with the
/// cost of one without correspondence. Where one did, it gets kUnverifiedCost, and whoever fuses maps has to ask the
/// views again. Where closely confirmed seeds go first, only views that confirm it closely count.
/// Other pixels, and those round which no plane is left, keep their own. A pixel that the mask ignores has none, and
/// goes on having none.
ACMP_HOST_DEVICE inline void FillPixel(const FillContext& context, int col, int row) {
  const ViewSupport support = context.support(col, row);
  const int views = context.strong_views > 0 ? StrictlyConsistentViews(support) : ConsistentViews(support);
  if (views >= context.min_views || !(context.planes(col, row).d > 0)) return;
  const NearestSeeds& nearest = context.nearest(col / context.cell_size, row / context.cell_size);
  ExtendedPlanes planes;
  FindExtendedPlanes(context, nearest, col, row, &planes);
  if (IsLooselyConsistent(support)) {
    const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
    KeepPlanesNear(PlaneDepth(context.planes(col, row), ray), &planes);
  }
  const int direction = WeightedQuantile(planes, DepthQuantile(context, col, row));
  if (direction < 0) return;
  const SeedCell& seed = context.fitted.data[nearest.cell[direction]];
  const PlaneHypothesis plane = PlaneOfInverse(seed.inverse_plane);
  if (!(plane.d > 0)) return;
  context.planes(col, row) = plane;
  context.cost(col, row) = views > 0 ? kUnverifiedCost : kWorstCost;
}

}  // namespace acmp
