#pragma once

#include "acmp_mapping/fill/kernel/fill_grid.h"

namespace acmp {

/// px, of the cells that are asked for evidence in their middle. The rim of a blank thing must be two cells wide, as
/// some directions step over every other one: of wider cells thin frames do not stop them.
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
    seed.inverse_depth = InverseDepthAt(context.rays, seed.inverse_plane, seed);
  }
  context.fitted(cell_col, cell_row) = seed;
}

/// Whether a plane, extended to a seed's pixel, passes clearly in front of the seed.
ACMP_HOST_DEVICE inline bool WouldHide(const FillContext& context, const Vec3f& inverse_plane, const SeedCell& seed) {
  constexpr float kInFront = 1.1f;
  return InverseDepthAt(context.rays, inverse_plane, seed) > kInFront * seed.inverse_depth;
}

// A sky and a blank wall look the same to a window: it fits everywhere. What tells them apart is their rim. Where a
// surface ends in front of something else its edge is seen, which moves with it from view to view; a sky has no edge of
// its own: all that is seen there are edges of roofs and trees. So where a surface that no texture speaks for would go
// on in front of something that is evidently farther away, it is not there.

/// kUnsupportedCost for a pixel of the surface in the middle of its cell where that is not textured and the pixel's
/// plane would hide the nearest textured seed in any of 16 directions. Other pixels keep their cost.
/// @param context `fitted` from FindTexturedSeed, `nearest` from FindNearestSeed
ACMP_HOST_DEVICE inline void RemoveUnsupportedPixel(const FillContext& context, int col, int row) {
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
  const NearestSeeds& nearest = context.nearest(cell_col, cell_row);
  bool hides = false;
  ACMP_UNROLL
  for (int i = 0; i < kNumDirections; ++i) {
    const int cell = nearest.cell[i];
    hides = hides || (cell >= 0 && WouldHide(context, inverse_plane, context.fitted.data[cell]));
  }
  if (hides) context.cost(col, row) = kUnsupportedCost;
}

}  // namespace acmp
