#include "acmp_mapping/fusion/depth_fusion.h"

#include <tbb/parallel_for.h>

#include "acmp_mapping/fusion/fusion_setup.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"

namespace acmp {
namespace {

using HostMaps = FusionMaps<Vec3f>;

/// add_points(row, &points) for all rows, in parallel; appends the points in the order of the rows.
template <class AddPoints>
void CollectRows(int height, const AddPoints& add_points, PointCloud* points) {
  std::vector<PointCloud> points_of_row(height);
  tbb::parallel_for(0, height, [&](int row) { add_points(row, &points_of_row[row]); });
  for (const PointCloud& row : points_of_row) points->insert(points->end(), row.begin(), row.end());
}

}  // namespace

Image<float> MeasureOdds(const FusionContext<HostMaps>& context) {
  Image<float> log_odds(context.reference.depth.width, context.reference.depth.height);
  tbb::parallel_for(0, log_odds.height(), [&](int row) {
    for (int col = 0; col < log_odds.width(); ++col) log_odds(col, row) = LogOdds(context, col, row);
  });
  return log_odds;
}

void FuseView(const FusionSetup<HostMaps>& setup, PointCloud* points) {
  FusionContext<HostMaps> context = setup.Context(setup.sources().data());
  const Image<float> log_odds = MeasureOdds(context);
  context.log_odds = log_odds.View();
  const auto fuse_row = [&](int row, PointCloud* points_of_row) {
    SurfacePoint point;
    for (int col = 0; col < context.reference.depth.width; ++col) {
      if (FusePixel<kMaxFusionSources>(context, col, row, &point)) points_of_row->push_back(point);
    }
  };
  CollectRows(context.reference.depth.height, fuse_row, points);
}

ConsistencyResult FilterByConsistency(const FusionView& reference, const std::vector<FusionView>& sources,
                                      const FusionOptions& options) {
  const FusionLimits limits = MakeFusionLimits(options);
  ConsistencyResult result;
  if (reference.depth.empty()) return result;
  CheckConsistencyInput(reference, sources, kMaxFusionSources);
  FusionSetup<HostMaps> setup(CameraOf(reference), MapsOf(reference), limits, RigidTransform::Identity());
  for (const FusionView& source : sources) {
    if (!source.depth.empty()) setup.AddSource(CameraOf(source), MapsOf(source));
  }
  FusionContext<HostMaps> context = setup.Context(setup.sources().data());
  const Image<float> log_odds = MeasureOdds(context);
  context.log_odds = log_odds.View();

  const int width = reference.depth.width, height = reference.depth.height;
  result.confidence = ConfidenceMap(width, height);
  const auto check_row = [&](int row, PointCloud* points) {
    SurfacePoint point;
    for (int col = 0; col < width; ++col) {
      if (CheckPixel<kMaxFusionSources>(context, col, row, &result.confidence(col, row), &point)) {
        points->push_back(point);
      }
    }
  };
  CollectRows(height, check_row, &result.points_in_camera);
  return result;
}

}  // namespace acmp
