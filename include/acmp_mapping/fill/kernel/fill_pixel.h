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
    if (!(fabsf(planes->inverse_depth[i] * depth - 1) < kSameSurface)) planes->weight[i] = 0;
  }
}

/// Direction of the weighted median: the least inverse depth up to which lies half of the weight or more. -1: no plane
/// has a weight.
ACMP_HOST_DEVICE inline int MedianPlane(const ExtendedPlanes& planes) {
  float total = 0;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) total += planes.weight[i];
  int median = -1;
  float least = 0;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) {
    const float inverse_depth = planes.inverse_depth[i];
    float up_to = 0;  // added in the same order: of the greatest it is the total
    ACMP_UNROLL
    for (int j = 0; j < kNumDirections; ++j) {
      up_to += planes.inverse_depth[j] <= inverse_depth ? planes.weight[j] : 0;
    }
    const bool is_median = planes.weight[i] > 0 && up_to >= 0.5f * total && (median < 0 || inverse_depth < least);
    median = is_median ? i : median;
    least = is_median ? inverse_depth : least;
  }
  return median;
}

/// Direction of the plane that the seeds elect: each votes, with its plane's weight at the pixel, for the planes on
/// which it lies, whichever seed they are of. A plane that goes on beyond its surface, or lies between two, has few.
/// -1: no plane has a vote.
ACMP_HOST_DEVICE inline int ElectPlane(const FillContext& context, const NearestSeeds& nearest,
                                       const ExtendedPlanes& planes) {
  constexpr float kOnPlane = 0.00375f;  // standard deviation of relative inverse depth (docs/experiments.md)
  unsigned candidates = 0;              // a bit for each direction
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) candidates |= planes.weight[i] > 0 ? 1u << i : 0;
  int elected = -1;
  float most = 0;
  for (int i = 0; i < kNumDirections; ++i) {
    if ((candidates >> i & 1) == 0) continue;
    const Vec3f plane = context.fitted.data[nearest.cell[i]].inverse_plane;
    float votes = 0;
    ACMP_UNROLL
    for (int j = 0; j < kNumDirections; ++j) {
      if (!(planes.weight[j] > 0)) continue;
      const SeedCell& seed = context.fitted.data[nearest.cell[j]];
      const float off = (InverseDepthAt(context.rays, plane, seed) / seed.inverse_depth - 1) * (1 / kOnPlane);
      votes += planes.weight[j] * expf(-0.5f * off * off);
    }
    elected = votes > most ? i : elected;
    most = Larger(votes, most);
  }
  return elected;
}

/// Whether a pixel has this cost because its plane was measured elsewhere: it was filled, or filtered.
ACMP_HOST_DEVICE inline bool IsFilled(float cost) { return cost >= kUnverifiedCost; }

/// A pixel that too few views confirm takes the plane that is the median of its surroundings', before passes the one
/// that they elect, near its own depth where a view nearly confirms that. Where no view confirmed it, it is an
/// unconfirmed pixel, with the cost of one without correspondence. Where one did, it gets kUnverifiedCost, and whoever
/// fuses maps has to ask the views again. Before passes only views that confirm it closely count.
/// Other pixels, and those round which no plane is left, keep their own. A pixel that the mask ignores has none, and
/// goes on having none.
ACMP_HOST_DEVICE inline void FillPixel(const FillContext& context, int col, int row) {
  const ViewSupport support = context.support(col, row);
  const bool for_passes = context.strong_views > 0;
  const int views = for_passes ? StrictlyConsistentViews(support) : ConsistentViews(support);
  if (views >= context.min_views || !(context.planes(col, row).d > 0)) return;
  const NearestSeeds& nearest = context.nearest(col / context.cell_size, row / context.cell_size);
  ExtendedPlanes planes;
  FindExtendedPlanes(context, nearest, col, row, &planes);
  if (IsLooselyConsistent(support)) {
    const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
    KeepPlanesNear(PlaneDepth(context.planes(col, row), ray), &planes);
  }
  const int direction = for_passes ? ElectPlane(context, nearest, planes) : MedianPlane(planes);
  if (direction < 0) return;
  const PlaneHypothesis plane = PlaneOfInverse(context.fitted.data[nearest.cell[direction]].inverse_plane);
  if (!(plane.d > 0)) return;
  context.planes(col, row) = plane;
  context.cost(col, row) = views > 0 ? kUnverifiedCost : kWorstCost;
}

}  // namespace acmp
