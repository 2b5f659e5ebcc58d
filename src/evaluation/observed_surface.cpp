#include "acmp_mapping/evaluation/cloud_metrics.h"

#include <cmath>
#include <unordered_set>

#include <tbb/parallel_for.h>

#include "acmp_mapping/fusion/kernel/match_pixel.h"
#include "acmp_mapping/geometry/voxel.h"

namespace acmp {

struct ObservedSurface::OccupiedVoxels {
  std::unordered_set<Voxel, VoxelHash> voxels;
};

ObservedSurface::ObservedSurface(const PointCloud& reconstruction, double spacing, double tolerance)
    : reconstruction_(reconstruction),
      spacing_(spacing),
      tolerance_(tolerance),
      observed_(reconstruction.size()),
      occupied_(std::make_unique<OccupiedVoxels>()) {
  CheckPositive("spacing", spacing);
  CheckPositive("tolerance", tolerance);
  for (size_t i = 0; i < reconstruction.size(); ++i) {
    const Vec3f& p = reconstruction[i].position;
    if (std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z)) continue;
    throw InvalidInputError(
        Concat("reconstruction: point ", i, " = (", p.x, ", ", p.y, ", ", p.z, "): coordinates must be finite"));
  }
}

ObservedSurface::~ObservedSurface() = default;

void ObservedSurface::Add(const DepthMap& depth, const PinholeCamera& camera, const RigidTransform& cam_from_world) {
  if (depth.width() != camera.width || depth.height() != camera.height) {
    throw InvalidInputError(Concat("depth map of ", depth.width(), " x ", depth.height(), ": must be the camera's ",
                                   camera.width, " x ", camera.height));
  }
  AddPoints(depth, camera, cam_from_world.inverse());
  MarkObserved(depth, camera, cam_from_world);
}

void ObservedSurface::AddPoints(const DepthMap& depth, const PinholeCamera& camera,
                                const RigidTransform& world_from_cam) {
  for (int row = 0; row < depth.height(); ++row) {
    for (int col = 0; col < depth.width(); ++col) {
      const float z = depth(col, row);
      if (!IsKnown(z)) continue;
      const Eigen::Vector3f p = (world_from_cam * camera.Unproject({col, row}, z)).cast<float>();
      SurfacePoint point = {};
      point.position = {p.x(), p.y(), p.z()};
      if (!FitsVoxels(point.position, spacing_)) {
        throw InvalidInputError(Concat("ground truth: pixel (", col, ", ", row, ") of depth ", z, " is at (", p.x(),
                                       ", ", p.y(), ", ", p.z(), "): coordinates must be at most ", kMaxVoxels,
                                       " spacings of ", spacing_, " from 0"));
      }
      if (occupied_->voxels.insert(VoxelOf(point.position, spacing_, 0.0)).second) cloud_.push_back(point);
    }
  }
}

void ObservedSurface::MarkObserved(const DepthMap& depth, const PinholeCamera& camera,
                                   const RigidTransform& cam_from_world) {
  tbb::parallel_for(size_t{0}, reconstruction_.size(), [&](size_t i) {
    if (observed_[i]) return;
    const Vec3f& p = reconstruction_[i].position;
    const Eigen::Vector3d in_cam = cam_from_world * Eigen::Vector3d(p.x, p.y, p.z);
    if (!(in_cam.z() > 0)) return;
    const Eigen::Vector2d pixel = camera.Project(in_cam);
    if (!camera.Contains(pixel)) return;
    // Contains lets -0.5 in, which rounds to -0; floor(x + 0.5) is the same rule without its exception at halves.
    const float z = depth(static_cast<int>(std::floor(pixel.x() + 0.5)), static_cast<int>(std::floor(pixel.y() + 0.5)));
    if (IsKnown(z) && in_cam.z() <= z + tolerance_) observed_[i] = 1;
  });
}

}  // namespace acmp
