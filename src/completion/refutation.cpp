#include "acmp_mapping/completion/refutation.h"

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

CompletionContext MakeEvidentContext(const PinholeCamera& camera, const ImageView<PlaneHypothesis>& planes,
                                     const ImageView<float>& cost) {
  CompletionContext context = {};
  context.rays = MakeRayGrid(camera);
  context.cell_size = EvidenceCellSize(camera.width, camera.height);
  context.planes = planes;
  context.cost = cost;
  return context;
}

void RefuteUnsupported(const PinholeCamera& camera, const ImageView<const float>& evidence,
                       const ImageView<PlaneHypothesis>& planes, const ImageView<float>& cost) {
  CompletionContext context = MakeEvidentContext(camera, planes, cost);
  const int cell_cols = CellsOf(camera.width, context.cell_size), cell_rows = CellsOf(camera.height, context.cell_size);
  CheckSize("planes", planes.width, planes.height, camera.width, camera.height);
  CheckSize("cost", cost.width, cost.height, camera.width, camera.height);
  CheckSize("evidence", evidence.width, evidence.height, cell_cols, cell_rows);
  Image<AnchorCell> evident(cell_cols, cell_rows);
  Image<NearestAnchors> nearest(cell_cols, cell_rows);
  context.fitted = evident.View();
  context.nearest = nearest.View();
  ForEach(cell_cols, cell_rows, [&](int col, int row) { FindEvidentAnchor(context, evidence, col, row); });
  FindAllNearestAnchors(context);
  ForEach(camera.width, camera.height, [&](int col, int row) { RefutePixel(context, col, row); });
}

}  // namespace acmp
