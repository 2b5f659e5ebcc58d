#pragma once

#include "acmp_mapping/completion/kernel/completion_grid.h"

namespace acmp {

constexpr int kNumDirections = 16;

/// Step of cells in one of 16 directions round the compass.
ACMP_HOST_DEVICE inline void DirectionStep(int direction, int* dc, int* dr) {
  // One quadrant: (1,0), (2,1), (1,1), (1,2); the others by turns of 90 degrees.
  const int step = direction % 4;
  const int c = step == 1 ? 2 : 1, r = step == 0 ? 0 : (step == 3 ? 2 : 1);
  const int quadrant = direction / 4;
  *dc = quadrant == 0 ? c : quadrant == 1 ? -r : quadrant == 2 ? -c : r;
  *dr = quadrant == 0 ? r : quadrant == 1 ? c : quadrant == 2 ? -r : -c;
}

/// A plane that could be extended to a pixel.
struct ExtendedPlane {
  float inverse_depth;  ///< at the pixel
  float distance;       ///< from the anchor, cells
  int cell;             ///< linear index of the anchor's cell
};

/// The nearest anchors in 16 directions whose planes meet the pixel's ray within the depth range, sorted by inverse
/// depth. Returns how many.
ACMP_HOST_DEVICE inline int FindExtendedPlanes(const CompletionContext& context, int col, int row,
                                               ExtendedPlane* found) {
  const ImageView<AnchorCell>& cells = context.fitted;
  const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
  int count = 0;
  for (int direction = 0; direction < kNumDirections; ++direction) {
    int dc, dr;
    DirectionStep(direction, &dc, &dr);
    int c = col / context.cell_size, r = row / context.cell_size;
    while (c >= 0 && r >= 0 && c < cells.width && r < cells.height && cells(c, r).views == 0) {
      c += dc;
      r += dr;
    }
    if (c < 0 || r < 0 || c >= cells.width || r >= cells.height) continue;
    const AnchorCell& anchor = cells(c, r);
    const float inverse_depth = Dot(anchor.inverse_plane, ray);
    if (!(inverse_depth * context.depth_min <= 1 && inverse_depth * context.depth_max >= 1)) continue;
    const float dx = static_cast<float>(anchor.col - col), dy = static_cast<float>(anchor.row - row);
    const ExtendedPlane plane = {inverse_depth, sqrtf(dx * dx + dy * dy) / static_cast<float>(context.cell_size),
                                 r * cells.width + c};
    int slot = count++;
    for (; slot > 0 && inverse_depth < found[slot - 1].inverse_depth; --slot) found[slot] = found[slot - 1];
    found[slot] = plane;
  }
  return count;
}

/// Index of the weighted median. Nearer anchors weigh more; the farther even the nearest is, the less the difference
/// counts.
ACMP_HOST_DEVICE inline int WeightedMedian(const ExtendedPlane* sorted, int count) {
  constexpr float kReach = 9.0f;        // cells in which the weight falls by e
  constexpr float kReachGrowth = 0.6f;  // cells more per cell to the nearest
  float nearest = sorted[0].distance;
  for (int i = 1; i < count; ++i) nearest = sorted[i].distance < nearest ? sorted[i].distance : nearest;
  const float inv_reach = 1.0f / (kReach + kReachGrowth * nearest);
  float weight[kNumDirections];
  float total = 0;
  for (int i = 0; i < count; ++i) total += weight[i] = expf((nearest - sorted[i].distance) * inv_reach);
  float rest = 0.5f * total;
  int median = 0;
  while (median + 1 < count && rest > weight[median]) rest -= weight[median++];
  return median;
}

/// Whether a pixel has this cost because its plane was measured elsewhere: it was completed, or filtered.
ACMP_HOST_DEVICE inline bool IsCompleted(float cost) { return cost >= kUnverifiedCost; }

/// A pixel that too few views confirm takes the plane that is the median of its surroundings'. Where no view did, that
/// is a guess, with the cost of a pixel without correspondence. Where one did, it gets kUnverifiedCost, and whoever
/// fuses maps has to ask the views again. Other pixels, and those round which nothing is confirmed, keep their own.
ACMP_HOST_DEVICE inline void CompletePixel(const CompletionContext& context, int col, int row) {
  const int views = ConfirmingViews(context.sightings(col, row));
  if (views >= context.min_views) return;
  ExtendedPlane found[kNumDirections];
  const int count = FindExtendedPlanes(context, col, row, found);
  if (count == 0) return;
  const int cell = found[WeightedMedian(found, count)].cell;
  const AnchorCell& anchor = context.fitted(cell % context.fitted.width, cell / context.fitted.width);
  const PlaneHypothesis plane = PlaneOfInverse(anchor.inverse_plane);
  if (!(plane.d > 0)) return;
  context.planes(col, row) = plane;
  context.cost(col, row) = views > 0 ? kUnverifiedCost : kWorstCost;
}

}  // namespace acmp
