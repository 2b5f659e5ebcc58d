#include "acmp_mapping/fusion/depth_fusion.h"

#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"
#include "acmp_mapping/geometry/vector_conversion.h"
#include "acmp_mapping/image/for_each_pixel.h"

namespace acmp {
namespace {

constexpr double kPi = 3.14159265358979323846;

ReferenceGeometry MakeReferenceGeometry(const PosedCamera& reference, const RigidTransform& target_from_reference) {
  const Eigen::Matrix3d rotation = target_from_reference.linear();
  return {ToMat3f(rotation * reference.camera.K().inverse()), ToMat3f(rotation),
          ToVec3f(target_from_reference.translation()), MakeRayGrid(reference.camera)};
}

SourceGeometry MakeSourceGeometry(const PosedCamera& reference, const PosedCamera& source,
                                  const RigidTransform& target_from_reference) {
  const RigidTransform reference_from_source = reference.cam_from_world * source.cam_from_world.inverse();
  const RigidTransform source_from_reference = source.cam_from_world * reference.cam_from_world.inverse();
  const Eigen::Matrix3d reference_k = reference.camera.K(), source_k = source.camera.K();
  SourceGeometry geometry;
  geometry.to_source = ToMat3f(source_k * source_from_reference.linear() * reference_k.inverse());
  geometry.to_source_offset = ToVec3f(source_k * source_from_reference.translation());
  geometry.to_reference = ToMat3f(reference_k * reference_from_source.linear() * source_k.inverse());
  geometry.to_reference_offset = ToVec3f(reference_k * reference_from_source.translation());
  geometry.target_from_camera = ToMat3f(target_from_reference.linear() * reference_from_source.linear());
  geometry.baseline = ToVec3f(target_from_reference.linear() * reference_from_source.translation());
  geometry.rays = MakeRayGrid(source.camera);
  return geometry;
}

/// The points of all pixels that become some, in row-major order: make_point(context, col, row, &point) says whether
/// one does.
template <class MakePoint>
PointCloud CollectPoints(const FusionSetup& setup, const MakePoint& make_point) {
  FusionContext context = setup.Context(setup.sources().data());
  const Image<float> log_odds = MeasureOdds(context);
  context.log_odds = log_odds.View();
  std::vector<PointCloud> points_of_row(static_cast<size_t>(log_odds.height()));
  tbb::parallel_for(0, log_odds.height(), [&](int row) {
    SurfacePoint point;
    for (int col = 0; col < log_odds.width(); ++col) {
      if (make_point(context, col, row, &point)) points_of_row[static_cast<size_t>(row)].push_back(point);
    }
  });
  PointCloud points;
  for (const PointCloud& row : points_of_row) points.insert(points.end(), row.begin(), row.end());
  return points;
}

}  // namespace

FusionLimits MakeFusionLimits(const FusionOptions& options) {
  const float max_px = options.max_reprojection_px;
  return {max_px * max_px, options.max_relative_depth,
          static_cast<float>(std::cos(options.max_normal_angle_deg * kPi / 180)), options.min_consistent_views,
          options.min_confidence};
}

Stamp StampOfRank(int rank) {
  CheckRange("rank of a fused view", rank, 0, kMaxFusionViews - 1);
  return static_cast<Stamp>(rank);
}

FusionSetup::FusionSetup(const PosedCamera& camera, const FusionMaps& maps, const FusionLimits& limits,
                         const RigidTransform& target_from_reference)
    : camera_(camera), target_from_reference_(target_from_reference) {
  context_.geometry = MakeReferenceGeometry(camera, target_from_reference);
  context_.reference = maps;
  context_.limits = limits;
}

void FusionSetup::AddSource(const PosedCamera& camera, const FusionMaps& maps, const ImageView<Stamp>& stamps) {
  sources_.push_back({MakeSourceGeometry(camera_, camera, target_from_reference_), maps, stamps});
}

Image<float> MeasureOdds(const FusionContext& context) {
  Image<float> log_odds(context.reference.depth.width, context.reference.depth.height);
  ForEachPixel(log_odds.width(), log_odds.height(),
               [&](int col, int row) { log_odds(col, row) = LogOdds(context, col, row); });
  return log_odds;
}

ConsistencyResult FilterByConsistency(const FusionSetup& setup) {
  ConsistencyResult result;
  result.confidence = ConfidenceMap(setup.camera().width, setup.camera().height);
  const auto check = [&](const FusionContext& context, int col, int row, SurfacePoint* point) {
    return CheckPixel(context, col, row, &result.confidence(col, row), point);
  };
  result.points_in_camera = CollectPoints(setup, check);
  return result;
}

PointCloud FuseView(const FusionSetup& setup) { return CollectPoints(setup, FusePixel); }

}  // namespace acmp
