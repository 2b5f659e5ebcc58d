#pragma once

#include <cstdint>

#include "acmp_mapping/common/thread_group.h"
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
  int seed_views;     ///< a pixel that so many source views confirm is a seed
  int min_views;      ///< one that fewer confirm is filled
  int strong_views;   ///< > 0, before passes: seeds that so many views confirm closely (is_strong) go
                      ///< first, and min_views, too, counts only views that confirm closely
  int cell_size;      ///< px
  bool near_and_far;  ///< whether neighbouring pixels take different planes
  ImageView<const ViewSupport> support;  ///< what the sources see of a pixel (CountSupportingViews)
  ImageView<PlaneHypothesis> planes;
  ImageView<float> cost;
  ImageView<SeedCell> seeds;   ///< as found; rows of cells
  ImageView<SeedCell> fitted;  ///< with the planes of their surroundings; no gaps between rows
  ImageView<NearestSeeds> nearest;
};

/// px, of the cells that have a seed each. Half as many give the same planes but lose small surfaces
/// (docs/experiments.md).
ACMP_HOST_DEVICE inline int FillCellSize(int width, int height) {
  constexpr int kCellsAcross = 108;
  return SizeOfCells(width, height, kCellsAcross);
}

// How many source views confirm a pixel, how many of them closely, whether some source nearly does, and how many
// sources look through it. Of more than these maxima no step asks.
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

  /// A strong one, then more views, at equal views less cost, and the first in row-major order among equals.
  ACMP_HOST_DEVICE bool IsBetterThan(const SeedChoice& other) const {
    if (is_strong != other.is_strong) return is_strong;
    if (views != other.views) return views > other.views;
    if (cost != other.cost) return cost < other.cost;
    return index < other.index;
  }
};

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
    seed.inverse_depth =
        Dot(seed.inverse_plane, context.rays.Ray(static_cast<float>(seed.col), static_cast<float>(seed.row)));
  }
  context.seeds(cell_col, cell_row) = seed;
}

}  // namespace acmp
