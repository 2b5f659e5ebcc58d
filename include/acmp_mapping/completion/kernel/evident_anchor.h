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

/// Whether a plane, extended to an anchor's pixel, passes clearly in front of the anchor.
ACMP_HOST_DEVICE inline bool WouldHide(const CompletionContext& context, const Vec3f& inverse_plane,
                                       const AnchorCell& anchor) {
  constexpr float kInFront = 1.1f;
  const Vec3f ray = context.rays.Ray(static_cast<float>(anchor.col), static_cast<float>(anchor.row));
  return Dot(inverse_plane, ray) > kInFront * anchor.inverse_depth;
}

}  // namespace acmp
