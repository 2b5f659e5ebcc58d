#include <tbb/parallel_for.h>

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {
namespace {

/// Pixels [col_begin, col_end) x [row_begin, row_end).
struct Cell {
  int col_begin, col_end, row_begin, row_end;
};

/// The cell's best pixel with a depth in range, the first in row-major order among equals. NaN costs and depths fail
/// the comparisons. False when none is below max_cost.
bool FindBest(ImageView<const float> depth, ImageView<const float> cost, const DepthRange& range, float max_cost,
              const Cell& cell, SupportPoint* best) {
  float best_cost = max_cost;
  bool found = false;
  for (int row = cell.row_begin; row < cell.row_end; ++row) {
    for (int col = cell.col_begin; col < cell.col_end; ++col) {
      const float z = depth(col, row);
      if (!(cost(col, row) < best_cost) || !(z >= range.min && z <= range.max)) continue;
      best_cost = cost(col, row);
      *best = {col, row, z};
      found = true;
    }
  }
  return found;
}

}  // namespace

void Validate(const PlanarPriorOptions& options) {
  CheckRange("planar_prior.cell_size_px", options.cell_size_px, 1, 64);
  if (!(options.max_support_cost > 0 && options.max_support_cost <= 2)) {
    throw InvalidInputError(
        Concat("planar_prior.max_support_cost = ", options.max_support_cost, ": must be in (0, 2]"));
  }
  if (!(options.max_grazing_angle_deg > 0 && options.max_grazing_angle_deg < 90)) {
    throw InvalidInputError(
        Concat("planar_prior.max_grazing_angle_deg = ", options.max_grazing_angle_deg, ": must be in (0, 90)"));
  }
}

std::vector<SupportPoint> FindSupportPoints(ImageView<const float> depth, ImageView<const float> cost,
                                            const DepthRange& range, const PlanarPriorOptions& options) {
  Validate(options);
  CheckDepthRange("depth range of the support points", range);
  if (depth.width != cost.width || depth.height != cost.height) {
    throw InvalidInputError(Concat("cost map is ", cost.width, " x ", cost.height, " but depth map is ", depth.width,
                                   " x ", depth.height, ": sizes must be equal"));
  }
  const int size = options.cell_size_px;
  const int cell_rows = (depth.height + size - 1) / size;
  std::vector<std::vector<SupportPoint>> points_of_row(cell_rows);
  tbb::parallel_for(0, cell_rows, [&](int cell_row) {
    const int row_begin = cell_row * size;
    const int row_end = std::min(row_begin + size, depth.height);
    for (int col_begin = 0; col_begin < depth.width; col_begin += size) {
      const Cell cell = {col_begin, std::min(col_begin + size, depth.width), row_begin, row_end};
      SupportPoint best;
      if (FindBest(depth, cost, range, options.max_support_cost, cell, &best)) points_of_row[cell_row].push_back(best);
    }
  });

  std::vector<SupportPoint> points;
  for (const auto& row : points_of_row) points.insert(points.end(), row.begin(), row.end());
  return points;
}

}  // namespace acmp
