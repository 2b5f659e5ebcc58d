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
struct AnchorCell {
  int views = 0;  ///< source views that confirm it; 0: the cell has none
  int col = 0, row = 0;
  float inverse_depth = 0;
  Vec3f inverse_plane = {0, 0, 0};  ///< of the pixel, later that of its surroundings
  bool is_sure = false;             ///< enough source views confirm it closely
};

constexpr int kNumDirections = 16;

/// What the source views see of a pixel (LookAtPixel), packed by PackSightings.
using Sightings = uint16_t;

/// The anchor to extend from each direction, from a cell on, itself included: linear index of its cell, -1: none.
struct NearestAnchors {
  int cell[kNumDirections];
};

/// What the steps of completion read and write.
struct CompletionContext {
  RayGrid rays;
  float depth_min, depth_max;
  int anchor_views;                      ///< pixels that so many source views confirm are extended
  int min_views;                         ///< to those that fewer than this confirm
  int sure_views;                        ///< > 0: the surest first. An anchor that so many source views confirm
                                         ///< closely is sure, and pixels need min_views that do so
  int cell_size;                         ///< px
  bool alternatives;                     ///< whether neighbouring pixels take different planes
  ImageView<const Sightings> sightings;  ///< what the sources see of a pixel (LookAtPixel)
  ImageView<PlaneHypothesis> planes;
  ImageView<float> cost;
  ImageView<AnchorCell> anchors;  ///< as found; rows of cells
  ImageView<AnchorCell> fitted;   ///< with the planes of their surroundings; no gaps between rows
  ImageView<NearestAnchors> nearest;
};

/// px, of the cells that have an anchor each. Half as many give the same planes but lose small surfaces
/// (docs/quality.md).
ACMP_HOST_DEVICE inline int CompletionCellSize(int width, int height) {
  constexpr int kCellsAcross = 108;
  return SizeOfCells(width, height, kCellsAcross);
}

// How many source views confirm a pixel, how many of them closely, whether some source nearly does, and how many
// sources look through it. Of more than these maxima no step asks.
constexpr int kMaxConfirming = 31;
constexpr int kMaxLookingThrough = 3;

ACMP_HOST_DEVICE inline Sightings PackSightings(int confirming, int closely_confirming, bool is_nearly_confirmed,
                                                int looking_through) {
  const int views = confirming < kMaxConfirming ? confirming : kMaxConfirming;
  const int close_views = closely_confirming < kMaxConfirming ? closely_confirming : kMaxConfirming;
  const int through = looking_through < kMaxLookingThrough ? looking_through : kMaxLookingThrough;
  return static_cast<Sightings>(close_views << 8 | through << 6 | (is_nearly_confirmed ? 1 : 0) << 5 | views);
}
ACMP_HOST_DEVICE inline int ConfirmingViews(Sightings sightings) { return sightings & kMaxConfirming; }
ACMP_HOST_DEVICE inline int CloselyConfirmingViews(Sightings sightings) { return sightings >> 8 & kMaxConfirming; }
ACMP_HOST_DEVICE inline bool IsNearlyConfirmed(Sightings sightings) { return (sightings >> 5 & 1) != 0; }
ACMP_HOST_DEVICE inline int LookingThrough(Sightings sightings) { return sightings >> 6 & kMaxLookingThrough; }

/// Whether a pixel may be extended: enough views confirm it and at most one looks through.
ACMP_HOST_DEVICE inline bool CanBeAnchor(Sightings sightings, int anchor_views) {
  return ConfirmingViews(sightings) >= anchor_views && LookingThrough(sightings) <= 1;
}

/// A pixel that may become the anchor of its cell.
struct AnchorChoice {
  bool is_sure = false;
  int views = 0;  ///< 0: none
  float cost = 0;
  int index = 0;  ///< row-major in the image

  /// A sure one, then more views, at equal views less cost, and the first in row-major order among equals.
  ACMP_HOST_DEVICE bool IsBetterThan(const AnchorChoice& other) const {
    if (is_sure != other.is_sure) return is_sure;
    if (views != other.views) return views > other.views;
    if (cost != other.cost) return cost < other.cost;
    return index < other.index;
  }
};

/// Fills one cell of `anchors`: the best of the pixels that can be one.
template <class Group>
ACMP_HOST_DEVICE inline void FindAnchor(const CompletionContext& context, int cell_col, int cell_row,
                                        const Group& group) {
  const int size = context.cell_size, width = context.planes.width;
  const int col_end = (cell_col + 1) * size < width ? (cell_col + 1) * size : width;
  const int row_end = (cell_row + 1) * size < context.planes.height ? (cell_row + 1) * size : context.planes.height;
  AnchorChoice best;
  for (int row = cell_row * size; row < row_end; ++row) {
    for (int col = cell_col * size + group.Rank(); col < col_end; col += Group::kSize) {
      const Sightings sightings = context.sightings(col, row);
      const int views = ConfirmingViews(sightings);
      if (!CanBeAnchor(sightings, context.anchor_views)) continue;
      const bool is_sure = context.sure_views > 0 && CloselyConfirmingViews(sightings) >= context.sure_views;
      const AnchorChoice choice = {is_sure, views, context.cost(col, row), row * width + col};
      if (choice.IsBetterThan(best)) best = choice;
    }
  }
  group.Best(&best);
  if (group.Rank() != 0) return;
  AnchorCell anchor;
  if (best.views > 0) {
    anchor.views = best.views;
    anchor.is_sure = best.is_sure;
    anchor.col = best.index % width;
    anchor.row = best.index / width;
    anchor.inverse_plane = InversePlane(context.planes(anchor.col, anchor.row));
    anchor.inverse_depth =
        Dot(anchor.inverse_plane, context.rays.Ray(static_cast<float>(anchor.col), static_cast<float>(anchor.row)));
  }
  context.anchors(cell_col, cell_row) = anchor;
}

}  // namespace acmp
