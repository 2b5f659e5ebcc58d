#pragma once

#include "acmp_mapping/fill/kernel/fill_grid.h"

namespace acmp {

/// px, of the cells that are asked for evidence in their middle. The rim of a blank thing must be two cells wide, as
/// some directions step over every other one: of wider cells thin frames do not stop them (docs/experiments.md).
ACMP_HOST_DEVICE inline int EvidenceCellSize(int width, int height) {
  constexpr int kCellsAcross = 160;
  return SizeOfCells(width, height, kCellsAcross);
}

/// Fills one cell of `fitted`: the pixel in its middle where that has texture, no seed elsewhere.
/// @param evidence DepthEvidence of these pixels
ACMP_HOST_DEVICE inline void FindTexturedSeed(const FillContext& context, const ImageView<const float>& evidence,
                                              int cell_col, int cell_row) {
  // Of a log-likelihood ratio: noise alone gives a few units either way, texture of twice the noise's variance 20 per
  // view.
  constexpr float kTextured = 10.0f;
  SeedCell seed;
  if (evidence(cell_col, cell_row) >= kTextured) {
    seed.views = 1;
    seed.col = MiddleOfCell(cell_col, context.cell_size, context.planes.width);
    seed.row = MiddleOfCell(cell_row, context.cell_size, context.planes.height);
    seed.inverse_plane = InversePlane(context.planes(seed.col, seed.row));
    seed.inverse_depth =
        Dot(seed.inverse_plane, context.rays.Ray(static_cast<float>(seed.col), static_cast<float>(seed.row)));
  }
  context.fitted(cell_col, cell_row) = seed;
}

/// Whether a plane, extended to a seed's pixel, passes clearly in front of the seed.
ACMP_HOST_DEVICE inline bool WouldHide(const FillContext& context, const Vec3f& inverse_plane, const SeedCell& seed) {
  constexpr float kInFront = 1.1f;
  const Vec3f ray = context.rays.Ray(static_cast<float>(seed.col), static_cast<float>(seed.row));
  return Dot(inverse_plane, ray) > kInFront * seed.inverse_depth;
}

}  // namespace acmp
