#pragma once

#include "acmp_mapping/completion/kernel/completion_grid.h"

namespace acmp {

/// px, of the cells that are asked for evidence in their middle. The rim of a blank thing must be two cells wide, as
/// some directions step over every other one: of wider cells thin frames do not stop them (docs/quality.md).
ACMP_HOST_DEVICE inline int EvidenceCellSize(int width, int height) {
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

/// As FindEvidentAnchor; where the middle is not evident, a pixel of the cell that may become an anchor of completion,
/// as something at no distance, which nothing hides: what lies beyond it is of another surface.
/// @param context with sightings
ACMP_HOST_DEVICE inline void FindEvidentOrAnchor(const CompletionContext& context,
                                                 const ImageView<const float>& evidence, int cell_col, int cell_row) {
  constexpr float kNoDistance = 1e30f;  // inverse depth
  FindEvidentAnchor(context, evidence, cell_col, cell_row);
  AnchorCell& found = context.fitted(cell_col, cell_row);
  if (found.views > 0) return;
  const int size = context.cell_size;
  for (int row = cell_row * size; row < (cell_row + 1) * size; ++row) {
    for (int col = cell_col * size; col < (cell_col + 1) * size; ++col) {
      if (!context.sightings.Contains(col, row)) continue;
      if (!CanBeAnchor(context.sightings(col, row), context.anchor_views)) continue;
      found.views = 1;
      found.col = col;
      found.row = row;
      found.inverse_depth = kNoDistance;
      return;
    }
  }
}

/// Whether a plane, extended to an anchor's pixel, passes clearly in front of the anchor.
ACMP_HOST_DEVICE inline bool WouldHide(const CompletionContext& context, const Vec3f& inverse_plane,
                                       const AnchorCell& anchor) {
  constexpr float kInFront = 1.1f;
  const Vec3f ray = context.rays.Ray(static_cast<float>(anchor.col), static_cast<float>(anchor.row));
  return Dot(inverse_plane, ray) > kInFront * anchor.inverse_depth;
}

}  // namespace acmp
