#pragma once

#include <cstdint>

#include "acmp_mapping/common/thread_group.h"
#include "acmp_mapping/fusion/kernel/match_pixel.h"
#include "acmp_mapping/geometry/plane_hypothesis.h"
#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// A plane as inverse depth over rays with z = 1: 1 / z = Dot(m, ray). Linear in the pixel, so that planes can be
/// fitted to inverse depths.
ACMP_HOST_DEVICE inline Vec3f InversePlane(const PlaneHypothesis& plane) { return (-1.0f / plane.d) * plane.normal(); }

/// Back again; no hypothesis where the plane does not lie in front of the camera.
ACMP_HOST_DEVICE inline PlaneHypothesis PlaneOfInverse(const Vec3f& inverse_plane) {
  const float norm = Norm(inverse_plane);
  if (!(norm > 0)) return {};
  const float d = 1.0f / norm;
  return {-d * inverse_plane.x, -d * inverse_plane.y, -d * inverse_plane.z, d};
}

/// The best confirmed pixel of a square cell of the image.
struct SeedCell {
  int views = 0;  ///< source views that confirm it; 0: the cell has none
  int col = 0, row = 0;
  float inverse_depth = 0;
  Vec3f inverse_plane = {0, 0, 0};  ///< of the pixel, later that of its surroundings
  bool is_strong = false;           ///< enough source views confirm it closely
};

constexpr int kNumDirections = 16;

/// What the source views see of a pixel (CountSupportingViews), packed by PackViewSupport.
using ViewSupport = uint16_t;

/// The seed to extend from each direction, from a cell on, itself included: linear index of its cell, -1: none.
struct NearestSeeds {
  int cell[kNumDirections];
};

/// What the kernels of the filling read and write.
struct FillContext {
  RayGrid rays;
  float depth_min, depth_max;
  int seed_views;    ///< a pixel that so many source views confirm is a seed
  int min_views;     ///< one that fewer confirm is filled
  int strong_views;  ///< 0: after passes. Else seeds that this many views confirm closely (is_strong) go first,
                     ///< min_views counts views that confirm closely, and a pixel takes the plane of most seeds
  int cell_size;     ///< px
  ImageView<const ViewSupport> support;  ///< what the sources see of a pixel (CountSupportingViews)
  ImageView<PlaneHypothesis> planes;
  ImageView<float> cost;
  ImageView<SeedCell> seeds;   ///< as found; rows of cells
  ImageView<SeedCell> fitted;  ///< with the planes of their surroundings; no gaps between rows
  ImageView<NearestSeeds> nearest;
};

/// px, of the cells that have a seed each. Half as many give the same planes but lose small surfaces.
ACMP_HOST_DEVICE inline int FillCellSize(int width, int height) {
  constexpr int kCellsAcross = 108;
  return SizeOfCells(width, height, kCellsAcross);
}

// How many source views confirm a pixel, how many of them closely, whether some source nearly does, and how many
// sources see through it. Of more than these maxima no step asks.
constexpr int kMaxConsistent = 31;
constexpr int kMaxFreeSpaceViolations = 3;

ACMP_HOST_DEVICE inline ViewSupport PackViewSupport(int confirming, int strictly_consistent, bool is_loosely_consistent,
                                                    int free_space_violations) {
  const int views = confirming < kMaxConsistent ? confirming : kMaxConsistent;
  const int close_views = strictly_consistent < kMaxConsistent ? strictly_consistent : kMaxConsistent;
  const int through = free_space_violations < kMaxFreeSpaceViolations ? free_space_violations : kMaxFreeSpaceViolations;
  return static_cast<ViewSupport>(close_views << 8 | through << 6 | (is_loosely_consistent ? 1 : 0) << 5 | views);
}
ACMP_HOST_DEVICE inline int ConsistentViews(ViewSupport support) { return support & kMaxConsistent; }
ACMP_HOST_DEVICE inline int StrictlyConsistentViews(ViewSupport support) { return support >> 8 & kMaxConsistent; }
ACMP_HOST_DEVICE inline bool IsLooselyConsistent(ViewSupport support) { return (support >> 5 & 1) != 0; }
ACMP_HOST_DEVICE inline int FreeSpaceViolations(ViewSupport support) { return support >> 6 & kMaxFreeSpaceViolations; }

/// A pixel that may become the seed of its cell.
struct SeedChoice {
  bool is_strong = false;
  int views = 0;  ///< 0: none
  float cost = 0;
  int index = 0;  ///< row-major in the image

  /// A closely confirmed one, then more views, at equal views less cost, and the first in row-major order among equals.
  ACMP_HOST_DEVICE bool IsBetterThan(const SeedChoice& other) const {
    if (is_strong != other.is_strong) return is_strong;
    if (views != other.views) return views > other.views;
    if (cost != other.cost) return cost < other.cost;
    return index < other.index;
  }
};

/// Of a plane, at a seed's pixel.
ACMP_HOST_DEVICE inline float InverseDepthAt(const RayGrid& rays, const Vec3f& inverse_plane, const SeedCell& seed) {
  return Dot(inverse_plane, rays.Ray(static_cast<float>(seed.col), static_cast<float>(seed.row)));
}

/// Fills one cell of `seeds`: the best of the pixels that enough views confirm.
template <class Group>
ACMP_HOST_DEVICE inline void FindSeed(const FillContext& context, int cell_col, int cell_row, const Group& group) {
  const int size = context.cell_size, width = context.planes.width;
  const int col_end = (cell_col + 1) * size < width ? (cell_col + 1) * size : width;
  const int row_end = (cell_row + 1) * size < context.planes.height ? (cell_row + 1) * size : context.planes.height;
  SeedChoice best;
  for (int row = cell_row * size; row < row_end; ++row) {
    for (int col = cell_col * size + group.Rank(); col < col_end; col += Group::kSize) {
      const ViewSupport support = context.support(col, row);
      const int views = ConsistentViews(support);
      if (views < context.seed_views) continue;
      const bool is_strong = context.strong_views > 0 && StrictlyConsistentViews(support) >= context.strong_views;
      const SeedChoice choice = {is_strong, views, context.cost(col, row), row * width + col};
      if (choice.IsBetterThan(best)) best = choice;
    }
  }
  group.Best(&best);
  if (group.Rank() != 0) return;
  SeedCell seed;
  if (best.views > 0) {
    seed.views = best.views;
    seed.is_strong = best.is_strong;
    seed.col = best.index % width;
    seed.row = best.index / width;
    seed.inverse_plane = InversePlane(context.planes(seed.col, seed.row));
    seed.inverse_depth = InverseDepthAt(context.rays, seed.inverse_plane, seed);
  }
  context.seeds(cell_col, cell_row) = seed;
}

constexpr int kFitRadius = 10;     ///< cells: the fit sees a square of 21 x 21 cells, 19 % of the image's width ...
constexpr int kFitStep = 2;        ///< ... of which every second one in every second row gives a seed
constexpr int kFitIterations = 3;  ///< of reweighted least squares
constexpr float kFitTolerance = 0.01f;       ///< relative inverse depth that counts as the same plane's
constexpr float kFirstFitTolerance = 0.02f;  ///< at first, when the plane is that of one pixel
constexpr float kCutOff = 3.0f;              ///< Tukey's biweight vanishes at so many tolerances
constexpr float kMinFitViews = 4.0f;         ///< summed over the seeds; with less the pixel's own plane is as good

/// Normal equations of inverse depth, relative to that of the seed, as a linear function of the place: 1, x, y.
struct PlaneFit {
  float s1 = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;  ///< weighted sums
  float q = 0, qx = 0, qy = 0;

  ACMP_HOST_DEVICE void Add(float weight, float x, float y, float value) {
    s1 += weight;
    sx += weight * x;
    sy += weight * y;
    sxx += weight * x * x;
    sxy += weight * x * y;
    syy += weight * y * y;
    q += weight * value;
    qx += weight * x * value;
    qy += weight * y * value;
  }

  /// Offset and slopes. A slope that the points leave open is small: places are of size 1, and a ten-thousandth of the
  /// points' weight pulls it to zero.
  ACMP_HOST_DEVICE Vec3f Solve() const {
    const float ridge = 1e-4f * s1;
    const float inv = 1.0f / s1;
    const float xx = sxx + ridge - sx * sx * inv, xy = sxy - sx * sy * inv, yy = syy + ridge - sy * sy * inv;
    const float x = qx - sx * q * inv, y = qy - sy * q * inv;
    const float inv_det = 1.0f / (xx * yy - xy * xy);  // positive: both are at least the ridge
    const float slope_x = (yy * x - xy * y) * inv_det, slope_y = (xx * y - xy * x) * inv_det;
    return {inv * (q - slope_x * sx - slope_y * sy), slope_x, slope_y};
  }
};

/// How many of `threads`, a power of two, share a row of `count` seeds: the fewest that take it at once.
ACMP_HOST_DEVICE constexpr int ThreadsOfRow(int threads, int count) {
  return threads / 2 < count ? threads : ThreadsOfRow(threads / 2, count);
}

/// Tukey's biweight.
ACMP_HOST_DEVICE inline float RobustWeight(float residual, float tolerance) {
  const float ratio = residual / (kCutOff * tolerance);
  const float rest = 1.0f - ratio * ratio;
  return rest > 0 ? rest * rest : 0;
}

/// Fills one cell of `fitted`: the seed with the plane of the seeds around that agree with it, by reweighted least
/// squares from the plane of the seed's own pixel. The threads of a group share its rows and columns.
template <class Group>
ACMP_HOST_DEVICE inline void FitSeed(const FillContext& context, int cell_col, int cell_row, const Group& group) {
  constexpr int kMaxSeeds = 2 * kFitRadius / kFitStep + 1;  // of a row
  constexpr int kThreadsOfRow = ThreadsOfRow(Group::kSize, kMaxSeeds);
  constexpr int kRowsAtOnce = Group::kSize / kThreadsOfRow;
  SeedCell seed = context.seeds(cell_col, cell_row);
  if (seed.views == 0) {
    if (group.Rank() == 0) context.fitted(cell_col, cell_row) = seed;
    return;
  }
  const float reach = static_cast<float>(kFitRadius * context.cell_size);  // px that are 1 in the fit
  const float inv_reach = 1.0f / reach;
  const float inv_depth = seed.inverse_depth, depth = 1.0f / inv_depth;
  Vec3f m = seed.inverse_plane;
  // Relative to the seed's inverse depth: its own value, slopes per reach.
  Vec3f fit = {1.0f, m.x * context.rays.inv_fx * reach / inv_depth, m.y * context.rays.inv_fy * reach / inv_depth};
  static_assert(kFitRadius % kFitStep == 0, "the seed itself is one of those");
  const int first_col = cell_col > kFitRadius ? cell_col - kFitRadius : cell_col % kFitStep;
  const int first_row = cell_row > kFitRadius ? cell_row - kFitRadius : cell_row % kFitStep;
  const int last_col = cell_col + kFitRadius < context.seeds.width ? cell_col + kFitRadius : context.seeds.width - 1;
  const int last_row = cell_row + kFitRadius < context.seeds.height ? cell_row + kFitRadius : context.seeds.height - 1;
  for (int iteration = 0; iteration < kFitIterations; ++iteration) {
    const float tolerance = iteration == 0 ? kFirstFitTolerance : kFitTolerance;
    PlaneFit sums;
    for (int row = first_row + kFitStep * (group.Rank() / kThreadsOfRow); row <= last_row;
         row += kFitStep * kRowsAtOnce) {
      for (int col = first_col + kFitStep * (group.Rank() % kThreadsOfRow); col <= last_col;
           col += kFitStep * kThreadsOfRow) {
        const SeedCell& other = context.seeds(col, row);
        if (other.views == 0) continue;
        const float x = static_cast<float>(other.col - seed.col) * inv_reach;
        const float y = static_cast<float>(other.row - seed.row) * inv_reach;
        const float value = other.inverse_depth * depth;
        const float weight = RobustWeight(value - (fit.x + fit.y * x + fit.z * y), tolerance);
        if (weight > 0) sums.Add(weight * static_cast<float>(other.views), x, y, value);
      }
    }
    group.AddUp(&sums);
    if (!(sums.s1 > kMinFitViews)) break;
    fit = sums.Solve();
  }
  const Vec3f ray = context.rays.Ray(static_cast<float>(seed.col), static_cast<float>(seed.row));
  m.x = inv_depth * fit.y / (reach * context.rays.inv_fx);
  m.y = inv_depth * fit.z / (reach * context.rays.inv_fy);
  m.z = inv_depth * fit.x - m.x * ray.x - m.y * ray.y;
  seed.inverse_plane = m;
  if (group.Rank() == 0) context.fitted(cell_col, cell_row) = seed;
}

/// ViewSupport of a pixel of the reference; 0 without a depth, which nobody sees. A view confirms it within the limits
/// on reprojection and depth, closely within two thirds of the latter, nearly within twice the one and four times the
/// other. Normals do not count: where there is little texture they are noise, and the depths still agree.
ACMP_HOST_DEVICE inline ViewSupport CountSupportingViews(const FusionContext& context, int col, int row) {
  ReferencePixel pixel;
  if (!LoadReferencePlace(context, col, row, &pixel)) return 0;
  constexpr float kNearlySquaredPx = 4, kNearlyDepth = 4, kCloselyDepth = 2.0f / 3;
  int confirming = 0, strictly_consistent = 0, free_space_violations = 0;
  bool is_loosely_consistent = false;
  for (int i = 0; i < context.num_sources; ++i) {
    SourcePlace place;
    ViewAgreement agreement;
    if (!LocateInSource(context.sources[i], pixel.homogeneous, &place)) continue;
    if (context.sources[i].view.IsUnconfirmed(place.col, place.row)) continue;
    if (!ProjectBack(context.sources[i], context.limits.ByProbability(), pixel, place, &agreement)) continue;
    if (ViolatesFreeSpace(agreement)) ++free_space_violations;
    const float squared_px = context.limits.max_squared_px, relative_depth = context.limits.max_relative_depth;
    is_loosely_consistent |= agreement.squared_px < kNearlySquaredPx * squared_px &&
                             agreement.relative_depth < kNearlyDepth * relative_depth;
    const bool confirms = agreement.squared_px < squared_px && agreement.relative_depth < relative_depth;
    confirming += confirms ? 1 : 0;
    strictly_consistent += confirms && agreement.relative_depth < kCloselyDepth * relative_depth ? 1 : 0;
  }
  return PackViewSupport(confirming, strictly_consistent, is_loosely_consistent, free_space_violations);
}

/// Step of cells in one of 16 directions round the compass.
ACMP_HOST_DEVICE inline void DirectionStep(int direction, int* dc, int* dr) {
  // One quadrant: (1,0), (2,1), (1,1), (1,2); the others by turns of 90 degrees.
  const int step = direction % 4;
  const int c = step == 1 ? 2 : 1, r = step == 0 ? 0 : (step == 3 ? 2 : 1);
  const int quadrant = direction / 4;
  *dc = quadrant == 0 ? c : quadrant == 1 ? -r : quadrant == 2 ? -c : r;
  *dr = quadrant == 0 ? r : quadrant == 1 ? c : quadrant == 2 ? -r : -c;
}

/// Fills one direction of one cell of `nearest`: the first seed, or a closely confirmed one that is not much farther
/// away. Looks at `kAtOnce` cells before it asks what they have: a GPU thread waits for all of them together.
template <int kAtOnce = 1>
ACMP_HOST_DEVICE inline void FindNearestSeed(const FillContext& context, int cell_col, int cell_row, int direction) {
  constexpr int kTimesAsFar = 8, kStepsMore = 2;
  const ImageView<SeedCell>& cells = context.fitted;
  int dc, dr;
  DirectionStep(direction, &dc, &dr);
  int found = -1, last_step = cells.width + cells.height;
  for (int first = 0; first <= last_step && cells.Contains(cell_col + first * dc, cell_row + first * dr);
       first += kAtOnce) {
    bool is_seed[kAtOnce], is_strong[kAtOnce];
    ACMP_UNROLL
    for (int i = 0; i < kAtOnce; ++i) {
      const int col = cell_col + (first + i) * dc, row = cell_row + (first + i) * dr;
      const bool is_inside = cells.Contains(col, row);
      is_seed[i] = is_inside && cells(col, row).views > 0;
      is_strong[i] = is_inside && cells(col, row).is_strong;
    }
    ACMP_UNROLL
    for (int i = 0; i < kAtOnce; ++i) {
      const int step = first + i;
      if (step > last_step || !is_seed[i] || (found >= 0 && !is_strong[i])) continue;
      found = (cell_row + step * dr) * cells.width + cell_col + step * dc;
      const bool is_final = is_strong[i] || context.strong_views == 0;
      last_step = is_final ? -1 : kTimesAsFar * step + kStepsMore;
    }
  }
  context.nearest(cell_col, cell_row).cell[direction] = found;
}

}  // namespace acmp
