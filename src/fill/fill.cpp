#include "acmp_mapping/fill/fill.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fill/kernel/fill_grid.h"
#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "acmp_mapping/fill/kernel/weighted_median.h"
#include "acmp_mapping/image/for_each_pixel.h"

namespace acmp {
namespace {

/// FindNearestSeed for all cells and directions.
void FindAllNearestSeeds(const FillContext& context) {
  ForEachPixel(context.nearest.width, context.nearest.height, [&](int col, int row) {
    for (int direction = 0; direction < kNumDirections; ++direction) FindNearestSeed(context, col, row, direction);
  });
}

Image<ViewSupport> CountAllSupportingViews(const FusionSetup& setup) {
  const FusionContext context = setup.Context(setup.sources().data());
  Image<ViewSupport> support(context.reference.depth.width, context.reference.depth.height);
  ForEachPixel(support.width(), support.height(),
               [&](int col, int row) { support(col, row) = CountSupportingViews(context, col, row); });
  return support;
}

/// WeightedMedianPixel for all pixels of the completed reference.
/// @param view support of the reference as it was before; become those of the completed one
void FilterByMedian(const FusionSetup& setup, const FillContext& filled, Image<ViewSupport>* support) {
  const ImageView<PlaneHypothesis>& planes = filled.planes;
  const int width = planes.width, height = planes.height;
  DepthMap depth(width, height);
  ForEachPixel(width, height, [&](int col, int row) {
    const PlaneHypothesis& plane = planes(col, row);
    if (!(plane.d > 0)) return;
    depth(col, row) = PlaneDepth(plane, filled.rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  });
  FusionContext context = setup.Context(setup.sources().data());
  context.reference.depth = depth.View();  // CountSupportingViews reads no normals
  context.reference.cost = filled.cost;
  PlaneMap filtered(width, height);
  const MedianContext median = {filled.rays,     filled.depth_min,        filled.depth_max, planes,     depth.View(),
                                support->View(), context.reference.color, filtered.View(),  filled.cost};
  ForEachPixel(width, height, [&](int col, int row) {
    if (IsFilled(filled.cost(col, row))) (*support)(col, row) = CountSupportingViews(context, col, row);
  });
  ForEachPixel(width, height, [&](int col, int row) { WeightedMedianPixel(median, col, row); });
  ForEachPixel(width, height, [&](int col, int row) { planes(col, row) = filtered(col, row); });
}

}  // namespace

FusionLimits ConsistencyLimits() {
  constexpr float kMaxReprojectionPx = 2, kMaxRelativeDepth = 0.003f;
  FusionLimits limits = {};
  limits.max_squared_px = kMaxReprojectionPx * kMaxReprojectionPx;
  limits.max_relative_depth = kMaxRelativeDepth;
  return limits;
}

int SeedViews(int num_sources) {
  constexpr int kEnough = 4;
  return std::min(kEnough, (num_sources + 1) / 2);
}

int MinConsistentViews(int num_sources) {
  constexpr int kFewSources = 7;
  return std::min(num_sources < kFewSources ? 1 : 2, SeedViews(num_sources));
}

int StrongViews(int num_sources) { return std::min(SeedViews(num_sources) + 1, (num_sources + 1) / 2); }

FillContext MakeFillContext(const PinholeCamera& camera, const DepthRange& range, const FillOptions& options,
                            int num_sources) {
  CheckDepthRange("depth range of the completion", range);
  FillContext context = {};
  context.rays = MakeRayGrid(camera);
  context.depth_min = range.min;
  context.depth_max = range.max;
  context.seed_views = SeedViews(num_sources);
  context.min_views = MinConsistentViews(num_sources);
  context.strong_views = options.for_passes ? StrongViews(num_sources) : 0;
  context.cell_size = FillCellSize(camera.width, camera.height);
  return context;
}

void FillUnverified(const FusionSetup& setup, const DepthRange& range, const FillOptions& options,
                    const ImageView<PlaneHypothesis>& planes, const ImageView<float>& cost) {
  FillContext context = MakeFillContext(setup.camera(), range, options, static_cast<int>(setup.sources().size()));
  if (setup.sources().empty()) return;
  Image<ViewSupport> support = CountAllSupportingViews(setup);
  const int cell_cols = CellsOf(planes.width, context.cell_size), cell_rows = CellsOf(planes.height, context.cell_size);
  Image<SeedCell> seeds(cell_cols, cell_rows), fitted(cell_cols, cell_rows);
  Image<NearestSeeds> nearest(cell_cols, cell_rows);
  context.support = support.View();
  context.planes = planes;
  context.cost = cost;
  context.seeds = seeds.View();
  context.fitted = fitted.View();
  context.nearest = nearest.View();
  ForEachPixel(cell_cols, cell_rows, [&](int col, int row) { FindSeed(context, col, row, SingleThread()); });
  ForEachPixel(cell_cols, cell_rows, [&](int col, int row) { FitSeed(context, col, row, SingleThread()); });
  FindAllNearestSeeds(context);
  ForEachPixel(planes.width, planes.height, [&](int col, int row) { FillPixel(context, col, row); });
  if (options.weighted_median) FilterByMedian(setup, context, &support);
}

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
  CheckSize("planes", planes.width, planes.height, camera);
  CheckSize("cost", cost.width, cost.height, camera);
  CheckRange("columns of the evidence", evidence.width, cell_cols, cell_cols);
  CheckRange("rows of the evidence", evidence.height, cell_rows, cell_rows);
  Image<SeedCell> textured(cell_cols, cell_rows);
  Image<NearestSeeds> nearest(cell_cols, cell_rows);
  context.fitted = textured.View();
  context.nearest = nearest.View();
  ForEachPixel(cell_cols, cell_rows, [&](int col, int row) { FindTexturedSeed(context, evidence, col, row); });
  FindAllNearestSeeds(context);
  ForEachPixel(camera.width, camera.height, [&](int col, int row) { RemoveUnsupportedPixel(context, col, row); });
}

}  // namespace acmp
