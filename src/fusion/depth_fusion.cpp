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

Image<float> MeasureErrors(const FusionContext<HostMaps>& context) {
  Image<float> log_error(context.reference.depth.width, context.reference.depth.height);
  tbb::parallel_for(0, log_error.height(), [&](int row) {
    for (int col = 0; col < log_error.width(); ++col) log_error(col, row) = LogExpectedError(context, col, row);
  });
  return log_error;
}

void FuseView(const FusionSetup<HostMaps>& setup, PointCloud* points) {
  FusionContext<HostMaps> context = setup.Context(setup.sources().data());
  const Image<float> log_error = MeasureErrors(context);
  context.log_error = log_error.View();
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
  const Image<float> log_error = MeasureErrors(context);
  context.log_error = log_error.View();

  const int width = reference.depth.width, height = reference.depth.height;
  result.consistent_views = Image<unsigned char>(width, height);
  result.confidence = ConfidenceMap(width, height);
  const auto check_row = [&](int row, PointCloud* points) {
    SurfacePoint point;
    for (int col = 0; col < width; ++col) {
      const PixelConsistency pixel = CheckPixel<kMaxFusionSources>(context, col, row, &point);
      result.consistent_views(col, row) = static_cast<unsigned char>(pixel.consistent_views);
      result.confidence(col, row) = pixel.confidence;
      if (pixel.accepted) points->push_back(point);
    }
  };
  CollectRows(height, check_row, &result.points_in_camera);
  return result;
}

}  // namespace acmp
