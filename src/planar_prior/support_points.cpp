#include <tbb/parallel_for.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/planar_prior/planar_prior.h"

namespace acmp {
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
  const int cell_cols = (depth.width + size - 1) / size;
  std::vector<std::vector<SupportPoint>> points_of_row(cell_rows);
  tbb::parallel_for(0, cell_rows, [&](int cell_row) {
    for (int cell_col = 0; cell_col < cell_cols; ++cell_col) {
      const SupportPoint best =
          FindSupportPointOfCell(depth, cost, range.min, range.max, options.max_support_cost, size, cell_col, cell_row);
      if (best.depth > 0) points_of_row[cell_row].push_back(best);
    }
  });

  std::vector<SupportPoint> points;
  for (const auto& row : points_of_row) points.insert(points.end(), row.begin(), row.end());
  return points;
}

}  // namespace acmp
