#include "acmp_mapping/fusion/voxel_map.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/label_votes.h"
#include "acmp_mapping/geometry/vector_conversion.h"

namespace acmp {
namespace {

/// Several clouds as one, in the target frame.
template <class Cloud>
class PlacedPoints {
 public:
  explicit PlacedPoints(const std::vector<PlacedCloud<Cloud>>& clouds) : clouds_(clouds) {
    for (const PlacedCloud<Cloud>& cloud : clouds) {
      begins_.push_back(size_);
      size_ += cloud.points->size();
    }
  }

  size_t size() const { return size_; }

  SurfacePoint operator[](size_t index) const {
    const auto next = std::upper_bound(begins_.begin(), begins_.end(), index);
    const PlacedCloud<Cloud>& cloud = clouds_[static_cast<size_t>(next - begins_.begin()) - 1];
    SurfacePoint point = (*cloud.points)[index - *std::prev(next)];
    point.position = ToVec3f(cloud.target_from_cloud * (cloud.scale * ToEigen(point.position)));
    point.normal = ToVec3f(cloud.target_from_cloud.linear() * ToEigen(point.normal));
    return point;
  }

 private:
  const std::vector<PlacedCloud<Cloud>>& clouds_;
  std::vector<size_t> begins_;
  size_t size_ = 0;
};

/// A point's voxel and its place in the input, as numbers that are quickly compared. The place is part of the order, so
/// voxels add up in input order however they were sorted.
struct VoxelEntry {
  uint64_t xy = 0, z_point = 0;

  VoxelEntry() = default;
  VoxelEntry(const Eigen::Vector3d& cell, size_t point)
      : xy(Biased(cell.x()) << 32 | Biased(cell.y())), z_point(Biased(cell.z()) << 32 | point) {}

  size_t point() const { return static_cast<uint32_t>(z_point); }
  bool SameVoxel(const VoxelEntry& o) const { return xy == o.xy && z_point >> 32 == o.z_point >> 32; }
  bool operator<(const VoxelEntry& o) const { return xy < o.xy || (xy == o.xy && z_point < o.z_point); }

 private:
  /// 32 bits that order as the coordinates do.
  static uint64_t Biased(double coordinate) {
    return static_cast<uint64_t>(static_cast<int64_t>(coordinate) + (int64_t{1} << 31));
  }
};

VoxelEntry Locate(const SurfacePoint& point, size_t index, double voxel_size) {
  const Eigen::Vector3d cell = (ToEigen(point.position) / voxel_size).array().floor();
  const Eigen::Vector3d limit = Eigen::Vector3d::Constant(std::numeric_limits<int32_t>::max());
  if (!(cell.cwiseAbs().array() <= limit.array()).all()) {  // NaN is refused, too
    throw InvalidInputError(Concat("point ", index, " at (", point.position.x, ", ", point.position.y, ", ",
                                   point.position.z, "): must be finite and within 2^31 voxels of size ", voxel_size));
  }
  if (!(point.confidence >= 0 && point.confidence <= 1)) {
    throw InvalidInputError(Concat("confidence of point ", index, " = ", point.confidence, ": must be in [0, 1]"));
  }
  return {cell, index};
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
    label_votes_.Add(point.label, weight);
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
    mean.label = label_votes_.Winner();
    mean.confidence = static_cast<float>(confidence_ / weight_);
    return mean;
  }

 private:
  double weight_ = 0, confidence_ = 0, strongest_weight_ = 0;
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero(), normal_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d color_ = Eigen::Vector3d::Zero(), strongest_normal_ = Eigen::Vector3d::Zero();
  LabelVotes label_votes_;
};

void CheckVoxelSize(float voxel_size) {
  if (voxel_size > 0 && std::isfinite(voxel_size)) return;
  throw InvalidInputError(Concat("voxel size = ", voxel_size, ": must be > 0 and finite"));
}

SurfacePoint AverageVoxel(const PointCloud& members) {
  double confidence_sum = 0;
  for (const SurfacePoint& point : members) confidence_sum += point.confidence;
  VoxelMean mean;
  for (const SurfacePoint& point : members) mean.Add(point, confidence_sum > 0 ? point.confidence : 1.0);
  return mean.Mean();
}

template <class Cloud>
PointCloud MergeAll(const std::vector<PlacedCloud<Cloud>>& clouds, float voxel_size) {
  CheckVoxelSize(voxel_size);
  const PlacedPoints<Cloud> points(clouds);
  CheckRange("number of points", points.size(), size_t{0}, size_t{std::numeric_limits<uint32_t>::max()});
  std::vector<VoxelEntry> entries(points.size());
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t i) { entries[i] = Locate(points[i], i, voxel_size); });
  tbb::parallel_sort(entries.begin(), entries.end());
  std::vector<uint32_t> begins;  // of each voxel's entries, and the end of the last one's
  for (size_t i = 0; i < entries.size(); ++i) {
    if (i == 0 || !entries[i].SameVoxel(entries[i - 1])) begins.push_back(static_cast<uint32_t>(i));
  }
  PointCloud means(begins.size());
  begins.push_back(static_cast<uint32_t>(entries.size()));
  tbb::parallel_for(tbb::blocked_range<size_t>(0, means.size()), [&](const tbb::blocked_range<size_t>& range) {
    PointCloud members;
    for (size_t voxel = range.begin(); voxel < range.end(); ++voxel) {
      // Moved once and through memory: GCC 12 may leave out the rounding to float32 where it keeps them in registers.
      members.clear();
      for (size_t i = begins[voxel]; i < begins[voxel + 1]; ++i) members.push_back(points[entries[i].point()]);
      means[voxel] = AverageVoxel(members);
    }
  });
  return means;
}

}  // namespace

PointCloud MergeClouds(const std::vector<PlacedCloud<PointCloud>>& clouds, float voxel_size) {
  return MergeAll(clouds, voxel_size);
}

PointCloud MergeClouds(const std::vector<PlacedCloud<PackedCloud>>& clouds, float voxel_size) {
  return MergeAll(clouds, voxel_size);
}

PointCloud VoxelFilter(const PointCloud& points, float voxel_size) {
  return MergeAll<PointCloud>({{RigidTransform::Identity(), &points}}, voxel_size);
}

void CheckPoints(const PointCloud& points, float voxel_size) {
  CheckVoxelSize(voxel_size);
  for (size_t i = 0; i < points.size(); ++i) Locate(points[i], i, voxel_size);
}

PointCloud Scaled(PointCloud points, double scale) {
  for (SurfacePoint& point : points) point.position = ToVec3f(scale * ToEigen(point.position));
  return points;
}

}  // namespace acmp
