#include "acmp_mapping/fusion/voxel_map.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>

#include "acmp_mapping/common/error.h"
#include "vector_conversion.h"

namespace acmp {
namespace {

/// A point's voxel and its place in the input.
struct VoxelEntry {
  int32_t x, y, z;
  uint32_t point;

  bool SameVoxel(const VoxelEntry& o) const { return x == o.x && y == o.y && z == o.z; }
  bool operator<(const VoxelEntry& o) const { return std::tie(x, y, z, point) < std::tie(o.x, o.y, o.z, o.point); }
};

VoxelEntry Locate(const SurfacePoint& point, size_t index, double voxel_size) {
  const Eigen::Vector3d cell = (ToEigen(point.position) / voxel_size).array().floor();
  const Eigen::Vector3d limit = Eigen::Vector3d::Constant(std::numeric_limits<int32_t>::max());
  if (!(cell.cwiseAbs().array() <= limit.array()).all()) {  // NaN is refused, too
    throw InvalidInputError(Concat("point ", index, " at (", point.position.x, ", ", point.position.y, ", ",
                                   point.position.z, "): must be finite and within 2^31 voxels of size ", voxel_size));
  }
  return {static_cast<int32_t>(cell.x()), static_cast<int32_t>(cell.y()), static_cast<int32_t>(cell.z()),
          static_cast<uint32_t>(index)};
}

/// Sums of weighted points; weights are confidences, or 1 where all of them are 0.
class VoxelMean {
 public:
  void Add(const SurfacePoint& point, double weight) {
    weight_ += weight;
    position_ += weight * ToEigen(point.position);
    normal_ += weight * ToEigen(point.normal);
    color_ += weight * Eigen::Vector3d(point.color.r, point.color.g, point.color.b);
    confidence_ += weight * point.confidence;
    if (weight > strongest_weight_) {
      strongest_weight_ = weight;
      strongest_normal_ = ToEigen(point.normal);
    }
  }

  SurfacePoint Mean() const {
    // Normals of two sides of a thin wall may cancel: the most confident point's decides then.
    const bool cancels = !(normal_.norm() > 1e-6 * weight_);
    const Eigen::Vector3d color = color_ / weight_;
    SurfacePoint mean;
    mean.position = ToVec3f(position_ / weight_);
    mean.normal = ToVec3f((cancels ? strongest_normal_ : normal_).normalized());
    mean.color = {static_cast<unsigned char>(std::lround(color.x())),
                  static_cast<unsigned char>(std::lround(color.y())),
                  static_cast<unsigned char>(std::lround(color.z()))};
    mean.confidence = static_cast<float>(confidence_ / weight_);
    return mean;
  }

 private:
  double weight_ = 0, confidence_ = 0, strongest_weight_ = 0;
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero(), normal_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d color_ = Eigen::Vector3d::Zero(), strongest_normal_ = Eigen::Vector3d::Zero();
};

SurfacePoint AverageVoxel(const PointCloud& points, const VoxelEntry* begin, const VoxelEntry* end) {
  double confidence_sum = 0;
  for (const VoxelEntry* entry = begin; entry != end; ++entry) confidence_sum += points[entry->point].confidence;
  VoxelMean mean;
  for (const VoxelEntry* entry = begin; entry != end; ++entry) {
    const SurfacePoint& point = points[entry->point];
    mean.Add(point, confidence_sum > 0 ? point.confidence : 1.0);
  }
  return mean.Mean();
}

void CheckPoints(const PointCloud& points) {
  CheckRange("number of points", points.size(), size_t{0}, size_t{std::numeric_limits<uint32_t>::max()});
  for (size_t i = 0; i < points.size(); ++i) {
    const float confidence = points[i].confidence;
    if (confidence >= 0 && confidence <= 1) continue;
    throw InvalidInputError(Concat("confidence of point ", i, " = ", confidence, ": must be in [0, 1]"));
  }
}

}  // namespace

PointCloud VoxelFilter(const PointCloud& points, float voxel_size) {
  if (!(voxel_size > 0 && std::isfinite(voxel_size))) {
    throw InvalidInputError(Concat("voxel size = ", voxel_size, ": must be > 0 and finite"));
  }
  CheckPoints(points);
  std::vector<VoxelEntry> entries(points.size());
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t i) { entries[i] = Locate(points[i], i, voxel_size); });
  // The point's place is part of the order, so equal voxels add up in input order whatever the sort does.
  tbb::parallel_sort(entries.begin(), entries.end());

  std::vector<size_t> first;  // entry at which each voxel begins
  for (size_t i = 0; i < entries.size(); ++i) {
    if (i == 0 || !entries[i].SameVoxel(entries[i - 1])) first.push_back(i);
  }
  PointCloud means(first.size());
  tbb::parallel_for(size_t{0}, first.size(), [&](size_t i) {
    const size_t end = i + 1 < first.size() ? first[i + 1] : entries.size();
    means[i] = AverageVoxel(points, entries.data() + first[i], entries.data() + end);
  });
  return means;
}

PointCloud Transform(const RigidTransform& target_from_source, const PointCloud& points) {
  PointCloud moved = points;
  tbb::parallel_for(size_t{0}, moved.size(), [&](size_t i) {
    moved[i].position = ToVec3f(target_from_source * ToEigen(points[i].position));
    moved[i].normal = ToVec3f(target_from_source.linear() * ToEigen(points[i].normal));
  });
  return moved;
}

}  // namespace acmp
