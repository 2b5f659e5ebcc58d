#pragma once

#include "acmp_mapping/completion/kernel/complete_pixel.h"

namespace acmp {

// A sky and a blank wall look the same to a window: it fits everywhere. What tells them apart is their rim. Where a
// surface ends in front of something else its edge is seen, which moves with it from view to view; a sky has no edge of
// its own: all that is seen there are edges of roofs and trees. So where a surface that no texture speaks for would go
// on in front of something that is evidently farther away, it is not there.

/// px, of the cells that are asked for evidence in their middle. The rim of a blank thing must be two cells wide, as
/// some directions step over every other one: of wider cells thin frames do not stop them (docs/quality.md).
ACMP_HOST_DEVICE inline int RefutationCellSize(int width, int height) {
  constexpr int kCellsAcross = 160;
  return SizeOfCells(width, height, kCellsAcross);
}

/// Fills one cell of `fitted`: the pixel in its middle where that is evident, no anchor elsewhere.
/// @param evidence DepthEvidence of these pixels
ACMP_HOST_DEVICE inline void FindEvidentAnchor(const CompletionContext& context, const ImageView<const float>& evidence,
                                               int cell_col, int cell_row) {
  // Of a log-likelihood ratio: noise alone gives a few units either way, texture of twice the noise's variance 20 per
  // view.
  constexpr float kEvident = 10.0f;
  AnchorCell anchor;
  if (evidence(cell_col, cell_row) >= kEvident) {
    anchor.views = 1;
    anchor.col = MiddleOfCell(cell_col, context.cell_size, context.planes.width);
    anchor.row = MiddleOfCell(cell_row, context.cell_size, context.planes.height);
    anchor.inverse_plane = InversePlane(context.planes(anchor.col, anchor.row));
    anchor.inverse_depth =
        Dot(anchor.inverse_plane, context.rays.Ray(static_cast<float>(anchor.col), static_cast<float>(anchor.row)));
  }
  context.fitted(cell_col, cell_row) = anchor;
}

/// Whether a plane, extended to an anchor's pixel, passes clearly in front of the anchor.
ACMP_HOST_DEVICE inline bool WouldHide(const CompletionContext& context, const Vec3f& inverse_plane,
                                       const AnchorCell& anchor) {
  constexpr float kInFront = 1.1f;
  const Vec3f ray = context.rays.Ray(static_cast<float>(anchor.col), static_cast<float>(anchor.row));
  return Dot(inverse_plane, ray) > kInFront * anchor.inverse_depth;
}

/// kRefutedCost for a pixel of the surface in the middle of its cell where that is not evident and the pixel's plane
/// would hide the nearest evident anchor in any of 16 directions. Other pixels keep their cost.
/// @param context `fitted` from FindEvidentAnchor, `nearest` from FindNearestAnchor
ACMP_HOST_DEVICE inline void RefutePixel(const CompletionContext& context, int col, int row) {
  constexpr float kSameSurface = 0.02f;
  const int cell_col = col / context.cell_size, cell_row = row / context.cell_size;
  if (context.fitted(cell_col, cell_row).views > 0) return;
  const PlaneHypothesis plane = context.planes(col, row);
  const PlaneHypothesis middle = context.planes(MiddleOfCell(cell_col, context.cell_size, context.planes.width),
                                                MiddleOfCell(cell_row, context.cell_size, context.planes.height));
  if (!(plane.d > 0 && middle.d > 0)) return;
  const Vec3f inverse_plane = InversePlane(plane);
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  const float inverse_depth = Dot(inverse_plane, ray);
  if (!(fabsf(Dot(InversePlane(middle), ray) - inverse_depth) <= kSameSurface * inverse_depth)) return;
  const NearestAnchors& nearest = context.nearest(cell_col, cell_row);
  bool hides = false;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) {
    const int cell = nearest.cell[i];
    hides = hides || (cell >= 0 && WouldHide(context, inverse_plane, context.fitted.data[cell]));
  }
  if (hides) context.cost(col, row) = kRefutedCost;
}

}  // namespace acmp
