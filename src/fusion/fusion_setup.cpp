#include "acmp_mapping/fusion/fusion_setup.h"

#include <Eigen/LU>
#include <cmath>
#include <string>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/vector_conversion.h"

namespace acmp {
namespace {

constexpr double kPi = 3.14159265358979323846;

template <class T>
void CheckSize(const std::string& name, const char* map, const ImageView<const T>& view, const PinholeCamera& camera) {
  if (view.width == camera.width && view.height == camera.height) return;
  throw InvalidInputError(Concat(name, ": ", map, " map is ", view.width, " x ", view.height, " but the camera is ",
                                 camera.width, " x ", camera.height, ": sizes must be equal"));
}

void CheckView(const std::string& name, const FusionView& view) {
  if (view.depth.empty()) return;  // takes no part, so may be anything
  CheckCamera(name.c_str(), view.camera);
  CheckSize(name, "depth", view.depth, view.camera);
  CheckSize(name, "normal", view.normal, view.camera);
  CheckSize(name, "cost", view.cost, view.camera);
  if (!view.color.empty()) CheckSize(name, "colour", view.color, view.camera);
  const Eigen::Matrix3d rotation = view.cam_from_world.linear();
  const double error = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  // Poses written with six digits are off by 1e-6 or so; a scale or a reflection is a mistake.
  if (!(error <= 1e-3) || !(rotation.determinant() > 0) || !view.cam_from_world.translation().allFinite()) {
    throw InvalidInputError(Concat(name, ": pose is not a finite rigid motion; R^T R differs from 1 by ", error,
                                   ", limit 0.001; det R = ", rotation.determinant(), ", must be > 0"));
  }
}

}  // namespace

void Validate(const FusionOptions& options) {
  if (!(options.max_reprojection_px > 0 && std::isfinite(options.max_reprojection_px))) {
    throw InvalidInputError(
        Concat("fusion.max_reprojection_px = ", options.max_reprojection_px, ": must be > 0 and finite"));
  }
  if (!(options.max_relative_depth > 0 && options.max_relative_depth < 1)) {
    throw InvalidInputError(Concat("fusion.max_relative_depth = ", options.max_relative_depth, ": must be in (0, 1)"));
  }
  if (!(options.max_normal_angle_deg > 0 && options.max_normal_angle_deg <= 180)) {
    throw InvalidInputError(
        Concat("fusion.max_normal_angle_deg = ", options.max_normal_angle_deg, ": must be in (0, 180]"));
  }
  CheckRange("fusion.min_consistent_views", options.min_consistent_views, 0, 32);
  CheckRange("fusion.min_confidence", options.min_confidence, 0.0f, 1.0f);
}

FusionLimits MakeFusionLimits(const FusionOptions& options) {
  Validate(options);
  const double max_px = options.max_reprojection_px;
  return {max_px * max_px, options.max_relative_depth, std::cos(options.max_normal_angle_deg * kPi / 180),
          options.min_consistent_views, options.min_confidence};
}

Stamp StampOfRank(int rank) {
  CheckRange("rank of a fused view", rank, 0, kMaxFusionViews - 1);
  return static_cast<Stamp>(rank);
}

Image<unsigned char> FusedOf(const ImageView<const Stamp>& stamps) {
  Image<unsigned char> used(stamps.width, stamps.height);
  for (int row = 0; row < stamps.height; ++row) {
    for (int col = 0; col < stamps.width; ++col) used(col, row) = stamps(col, row) == kUnfusedStamp ? 0 : 1;
  }
  return used;
}

Image<Stamp> StampsOfFused(const Image<unsigned char>& used, const PinholeCamera& camera) {
  if (used.width() != camera.width || used.height() != camera.height) {
    throw InvalidInputError(Concat("fused pixels: ", used.width(), " x ", used.height(), " px: must be ", camera.width,
                                   " x ", camera.height, ", as their frame"));
  }
  Image<Stamp> stamps(used.width(), used.height());
  for (size_t i = 0; i < used.size(); ++i) stamps.data()[i] = used.data()[i] == 0 ? kUnfusedStamp : StampOfRank(0);
  return stamps;
}

ReferenceGeometry MakeReferenceGeometry(const PosedCamera& reference, const RigidTransform& target_from_reference) {
  const Eigen::Matrix3d rotation = target_from_reference.linear();
  return {ToMat3d(rotation * reference.camera.K().inverse()), ToMat3d(rotation),
          ToVec3d(target_from_reference.translation())};
}

SourceGeometry MakeSourceGeometry(const PosedCamera& reference, const PosedCamera& source,
                                  const RigidTransform& target_from_reference) {
  const RigidTransform reference_from_source = reference.cam_from_world * source.cam_from_world.inverse();
  const RigidTransform source_from_reference = source.cam_from_world * reference.cam_from_world.inverse();
  const RigidTransform target_from_source = target_from_reference * reference_from_source;
  const Eigen::Matrix3d reference_k = reference.camera.K(), source_k = source.camera.K();
  SourceGeometry geometry;
  geometry.to_source = ToMat3d(source_k * source_from_reference.linear() * reference_k.inverse());
  geometry.to_source_offset = ToVec3d(source_k * source_from_reference.translation());
  geometry.to_reference = ToMat3d(reference_k * reference_from_source.linear() * source_k.inverse());
  geometry.to_reference_offset = ToVec3d(reference_k * reference_from_source.translation());
  geometry.target_from_camera = ToMat3d(target_from_source.linear());
  geometry.center = ToVec3d(target_from_source.translation());
  geometry.rays = MakeRayGrid(source.camera);
  return geometry;
}

void CheckConsistencyInput(const FusionView& reference, const std::vector<FusionView>& sources, int max_sources) {
  CheckRange("number of source views", sources.size(), size_t{0}, static_cast<size_t>(max_sources));
  CheckView("reference view", reference);
  for (size_t i = 0; i < sources.size(); ++i) CheckView(Concat("source view ", i), sources[i]);
}

}  // namespace acmp
