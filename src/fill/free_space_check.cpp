#include "acmp_mapping/fill/free_space_check.h"

#include "acmp_mapping/common/error.h"
#include "for_each_cell.h"

namespace acmp {
namespace {

void CheckSize(const char* name, int width, int height, int expected_width, int expected_height) {
  if (width == expected_width && height == expected_height) return;
  throw InvalidInputError(
      Concat(name, " is ", width, " x ", height, ": must be ", expected_width, " x ", expected_height));
}

}  // namespace

FillContext MakeTexturedContext(const PinholeCamera& camera, const ImageView<PlaneHypothesis>& planes,
                                const ImageView<float>& cost) {
  FillContext context = {};
  context.rays = MakeRayGrid(camera);
  context.cell_size = EvidenceCellSize(camera.width, camera.height);
  context.planes = planes;
  context.cost = cost;
  return context;
}

void RemoveUnsupported(const PinholeCamera& camera, const ImageView<const float>& evidence,
                       const ImageView<PlaneHypothesis>& planes, const ImageView<float>& cost) {
  FillContext context = MakeTexturedContext(camera, planes, cost);
  const int cell_cols = CellsOf(camera.width, context.cell_size), cell_rows = CellsOf(camera.height, context.cell_size);
  CheckSize("planes", planes.width, planes.height, camera.width, camera.height);
  CheckSize("cost", cost.width, cost.height, camera.width, camera.height);
  CheckSize("evidence", evidence.width, evidence.height, cell_cols, cell_rows);
  Image<SeedCell> textured(cell_cols, cell_rows);
  Image<NearestSeeds> nearest(cell_cols, cell_rows);
  context.fitted = textured.View();
  context.nearest = nearest.View();
  ForEach(cell_cols, cell_rows, [&](int col, int row) { FindTexturedSeed(context, evidence, col, row); });
  FindAllNearestSeeds(context);
  ForEach(camera.width, camera.height, [&](int col, int row) { RemoveUnsupportedPixel(context, col, row); });
}

}  // namespace acmp
