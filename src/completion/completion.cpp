#include "acmp_mapping/completion/completion.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/completion/kernel/complete_pixel.h"
#include "acmp_mapping/completion/kernel/fit_anchor.h"
#include "acmp_mapping/completion/kernel/sightings.h"
#include "acmp_mapping/completion/kernel/weighted_median.h"
#include "for_each_cell.h"

namespace acmp {
namespace {

using HostMaps = FusionMaps<Vec3f>;

Image<Sightings> LookAtAll(const FusionSetup<HostMaps>& setup) {
  const FusionContext<HostMaps> context = setup.Context(setup.sources().data());
  Image<Sightings> sightings(context.reference.depth.width, context.reference.depth.height);
  ForEach(sightings.width(), sightings.height(),
          [&](int col, int row) { sightings(col, row) = LookAtPixel(context, col, row); });
  return sightings;
}

/// FilterPixel for all pixels of the completed reference.
/// @param sightings of the reference as it was before; become those of the completed one
void FilterByMedian(const FusionSetup<HostMaps>& setup, const CompletionContext& completed,
                    Image<Sightings>* sightings) {
  const ImageView<PlaneHypothesis>& planes = completed.planes;
  const int width = planes.width, height = planes.height;
  DepthMap depth(width, height);
  ForEach(width, height, [&](int col, int row) {
    const PlaneHypothesis& plane = planes(col, row);
    if (!(plane.d > 0)) return;
    depth(col, row) = PlaneDepth(plane, completed.rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  });
  FusionContext<HostMaps> context = setup.Context(setup.sources().data());
  context.reference.depth = depth.View();  // LookAtPixel reads no normals
  context.reference.cost = completed.cost;
  PlaneMap filtered(width, height);
  const MedianContext median = {completed.rays, completed.depth_min, completed.depth_max,     planes,
                                depth.View(),   sightings->View(),   context.reference.color, filtered.View(),
                                completed.cost};
  ForEach(width, height, [&](int col, int row) {
    if (IsCompleted(completed.cost(col, row))) (*sightings)(col, row) = LookAtPixel(context, col, row);
  });
  ForEach(width, height, [&](int col, int row) { FilterPixel(median, col, row); });
  ForEach(width, height, [&](int col, int row) { planes(col, row) = filtered(col, row); });
}

}  // namespace

void Validate(const CompletionOptions& options) {
  CheckRange("completion.anchor_views", options.anchor_views, 1, kMaxConfirming);
  CheckRange("completion.max_reprojection_px", options.max_reprojection_px, 1e-3f, 1e3f);
  CheckRange("completion.max_relative_depth", options.max_relative_depth, 1e-6f, 0.999f);
}

FusionLimits ConfirmationLimits(const CompletionOptions& options) {
  FusionLimits limits = {};
  limits.max_squared_px = static_cast<double>(options.max_reprojection_px) * options.max_reprojection_px;
  limits.max_relative_depth = options.max_relative_depth;
  return limits;
}

int AnchorViews(const CompletionOptions& options, int num_sources) {
  return std::min(options.anchor_views, (num_sources + 1) / 2);
}

int MinConfirmingViews(const CompletionOptions& options, int num_sources) {
  constexpr int kFewSources = 7;
  return std::min(num_sources < kFewSources ? 1 : 2, AnchorViews(options, num_sources));
}

int SureViews(const CompletionOptions& options, int num_sources) {
  if (!options.surest_first) return 0;
  return std::min({options.anchor_views + 1, (num_sources + 1) / 2, kMaxConfirming});
}

CompletionContext MakeCompletionContext(const PinholeCamera& camera, const DepthRange& range,
                                        const CompletionOptions& options, int num_sources) {
  CompletionContext context = {};
  context.rays = MakeRayGrid(camera);
  context.depth_min = range.min;
  context.depth_max = range.max;
  context.anchor_views = AnchorViews(options, num_sources);
  context.min_views = MinConfirmingViews(options, num_sources);
  context.sure_views = SureViews(options, num_sources);
  context.cell_size = CompletionCellSize(camera.width, camera.height);
  context.alternatives = options.alternatives;
  return context;
}

void CompleteUnconfirmed(const FusionView& reference, const std::vector<FusionView>& sources, const DepthRange& range,
                         const CompletionOptions& options, ImageView<PlaneHypothesis> planes, ImageView<float> cost) {
  Validate(options);
  CheckDepthRange("depth range of the completion", range);
  CheckConsistencyInput(reference, sources, kMaxFusionSources);
  FusionSetup<HostMaps> setup(CameraOf(reference), MapsOf(reference), ConfirmationLimits(options),
                              RigidTransform::Identity());
  for (const FusionView& source : sources) {
    if (!source.depth.empty()) setup.AddSource(CameraOf(source), MapsOf(source));
  }
  if (setup.sources().empty()) return;

  Image<Sightings> sightings = LookAtAll(setup);
  CompletionContext context =
      MakeCompletionContext(reference.camera, range, options, static_cast<int>(setup.sources().size()));
  const int cell_cols = CellsOf(planes.width, context.cell_size), cell_rows = CellsOf(planes.height, context.cell_size);
  Image<AnchorCell> anchors(cell_cols, cell_rows), fitted(cell_cols, cell_rows);
  Image<NearestAnchors> nearest(cell_cols, cell_rows);
  context.sightings = sightings.View();
  context.planes = planes;
  context.cost = cost;
  context.anchors = anchors.View();
  context.fitted = fitted.View();
  context.nearest = nearest.View();
  ForEach(cell_cols, cell_rows, [&](int col, int row) { FindAnchor(context, col, row, SingleThread()); });
  ForEach(cell_cols, cell_rows, [&](int col, int row) { FitAnchor(context, col, row, SingleThread()); });
  FindAllNearestAnchors(context);
  ForEach(planes.width, planes.height, [&](int col, int row) { CompletePixel(context, col, row); });
  if (options.weighted_median) FilterByMedian(setup, context, &sightings);
}

}  // namespace acmp
