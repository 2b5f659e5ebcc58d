#include "acmp_mapping/fusion/voxel_map.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "vector_conversion.h"

namespace acmp {
namespace {

constexpr size_t kMaxBuckets = size_t{1} << 20;
constexpr size_t kPointsPerBucket = 256;   ///< on average, so that a bucket is sorted in the cache
constexpr size_t kParallelSort = 1 << 16;  ///< buckets above (a wall across the first axis) are sorted by all cores

/// Several clouds as one, in the target frame.
class PlacedPoints {
 public:
  explicit PlacedPoints(const std::vector<PlacedCloud>& clouds) : clouds_(clouds) {
    for (const PlacedCloud& cloud : clouds) {
      begins_.push_back(size_);
      size_ += cloud.points->size();
    }
  }

  size_t size() const { return size_; }

  SurfacePoint operator[](size_t index) const {
    const size_t cloud = CloudOf(index);
    return Moved(cloud, index - begins_[cloud]);
  }

  /// visit(index, point) for each index of the range.
  template <class Visit>
  void ForEach(const tbb::blocked_range<size_t>& range, const Visit& visit) const {
    size_t cloud = CloudOf(range.begin());
    for (size_t index = range.begin(); index < range.end(); ++index) {
      while (index - begins_[cloud] >= clouds_[cloud].points->size()) ++cloud;
      visit(index, Moved(cloud, index - begins_[cloud]));
    }
  }

 private:
  size_t CloudOf(size_t index) const {
    return static_cast<size_t>(std::upper_bound(begins_.begin(), begins_.end(), index) - begins_.begin()) - 1;
  }

  SurfacePoint Moved(size_t cloud, size_t index) const {
    const RigidTransform& target_from_cloud = clouds_[cloud].target_from_cloud;
    SurfacePoint point = (*clouds_[cloud].points)[index];
    point.position = ToVec3f(target_from_cloud * (clouds_[cloud].scale * ToEigen(point.position)));
    point.normal = ToVec3f(target_from_cloud.linear() * ToEigen(point.normal));
    return point;
  }

  const std::vector<PlacedCloud>& clouds_;
  std::vector<size_t> begins_;
  size_t size_ = 0;
};

/// A single cloud as it is.
class PlainPoints {
 public:
  explicit PlainPoints(const PointCloud& points) : points_(points) {}
  size_t size() const { return points_.size(); }
  const SurfacePoint& operator[](size_t index) const { return points_[index]; }
  template <class Visit>
  void ForEach(const tbb::blocked_range<size_t>& range, const Visit& visit) const {
    for (size_t index = range.begin(); index < range.end(); ++index) visit(index, points_[index]);
  }

 private:
  const PointCloud& points_;
};

/// A point's voxel and its place in the input.
struct VoxelEntry {
  int32_t x, y, z;
  uint32_t point;

  bool SameVoxel(const VoxelEntry& o) const { return x == o.x && y == o.y && z == o.z; }
  /// The point's place is part of the order, so voxels add up in input order however they were sorted.
  bool operator<(const VoxelEntry& o) const { return std::tie(x, y, z, point) < std::tie(o.x, o.y, o.z, o.point); }
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
  return {static_cast<int32_t>(cell.x()), static_cast<int32_t>(cell.y()), static_cast<int32_t>(cell.z()),
          static_cast<uint32_t>(index)};
}

/// Voxels between which all others lie, in the first two coordinates.
struct VoxelBounds {
  int64_t min_x = INT32_MAX, max_x = INT32_MIN, min_y = INT32_MAX, max_y = INT32_MIN;

  void Add(const VoxelBounds& o) {
    min_x = std::min(min_x, o.min_x);
    max_x = std::max(max_x, o.max_x);
    min_y = std::min(min_y, o.min_y);
    max_y = std::max(max_y, o.max_y);
  }
};

VoxelBounds FindBounds(const std::vector<VoxelEntry>& entries) {
  return tbb::parallel_reduce(
      tbb::blocked_range<size_t>(0, entries.size()), VoxelBounds(),
      [&](const tbb::blocked_range<size_t>& range, VoxelBounds bounds) {
        for (size_t i = range.begin(); i < range.end(); ++i) {
          bounds.Add({entries[i].x, entries[i].x, entries[i].y, entries[i].y});
        }
        return bounds;
      },
      [](VoxelBounds a, const VoxelBounds& b) {
        a.Add(b);
        return a;
      });
}

/// Divides voxels into buckets that follow each other in the order of the coordinates.
class Buckets {
 public:
  Buckets(const VoxelBounds& bounds, size_t most) : bounds_(bounds) {
    const auto limit = static_cast<int64_t>(most);
    while (Columns() > limit) ++shift_x_;
    const int64_t row_limit = shift_x_ > 0 ? 1 : std::max<int64_t>(1, limit / Columns());
    while (Rows() > row_limit) ++shift_y_;
    rows_ = Rows();
  }

  size_t size() const { return static_cast<size_t>(Columns() * rows_); }
  size_t Of(const VoxelEntry& entry) const {
    return static_cast<size_t>(((entry.x - bounds_.min_x) >> shift_x_) * rows_ +
                               ((entry.y - bounds_.min_y) >> shift_y_));
  }

 private:
  int64_t Columns() const { return ((bounds_.max_x - bounds_.min_x) >> shift_x_) + 1; }
  int64_t Rows() const { return ((bounds_.max_y - bounds_.min_y) >> shift_y_) + 1; }

  VoxelBounds bounds_;
  int shift_x_ = 0, shift_y_ = 0;
  int64_t rows_ = 1;
};

/// Entries of all points, bucket after bucket.
struct BucketedEntries {
  std::vector<VoxelEntry> entries;
  std::vector<size_t> begins;  ///< of each bucket in `entries`, and the end of the last one
};

BucketedEntries DivideIntoBuckets(const std::vector<VoxelEntry>& entries) {
  const Buckets buckets(FindBounds(entries), std::min(kMaxBuckets, entries.size() / kPointsPerBucket + 1));
  std::vector<std::atomic<uint32_t>> places(buckets.size());  // first counts, then where the next entry goes
  tbb::parallel_for(size_t{0}, entries.size(),
                    [&](size_t i) { places[buckets.Of(entries[i])].fetch_add(1, std::memory_order_relaxed); });
  BucketedEntries divided;
  size_t begin = 0;
  for (std::atomic<uint32_t>& place : places) {
    divided.begins.push_back(begin);
    begin += place.exchange(static_cast<uint32_t>(begin), std::memory_order_relaxed);
  }
  divided.begins.push_back(begin);
  divided.entries.resize(entries.size());
  tbb::parallel_for(size_t{0}, entries.size(), [&](size_t i) {
    divided.entries[places[buckets.Of(entries[i])].fetch_add(1, std::memory_order_relaxed)] = entries[i];
  });
  return divided;
}

template <class Points>
std::vector<VoxelEntry> LocateAll(const Points& points, double voxel_size) {
  std::vector<VoxelEntry> entries(points.size());
  tbb::parallel_for(tbb::blocked_range<size_t>(0, points.size()), [&](const tbb::blocked_range<size_t>& range) {
    points.ForEach(range,
                   [&](size_t index, const SurfacePoint& point) { entries[index] = Locate(point, index, voxel_size); });
  });
  return entries;
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

SurfacePoint AverageVoxel(const SurfacePoint* begin, const SurfacePoint* end) {
  double confidence_sum = 0;
  for (const SurfacePoint* point = begin; point != end; ++point) confidence_sum += point->confidence;
  VoxelMean mean;
  for (const SurfacePoint* point = begin; point != end; ++point) {
    mean.Add(*point, confidence_sum > 0 ? point->confidence : 1.0);
  }
  return mean.Mean();
}

/// Calls visit(begin, end) for the entries of each voxel of a sorted range.
template <class Visit>
void ForEachVoxel(const VoxelEntry* begin, const VoxelEntry* end, const Visit& visit) {
  while (begin != end) {
    const VoxelEntry* next = std::find_if_not(begin, end, [&](const VoxelEntry& e) { return e.SameVoxel(*begin); });
    visit(begin, next);
    begin = next;
  }
}

template <class Points>
PointCloud AverageVoxels(const Points& points, float voxel_size) {
  if (!(voxel_size > 0 && std::isfinite(voxel_size))) {
    throw InvalidInputError(Concat("voxel size = ", voxel_size, ": must be > 0 and finite"));
  }
  CheckRange("number of points", points.size(), size_t{0}, size_t{std::numeric_limits<uint32_t>::max()});
  if (points.size() == 0) return {};
  BucketedEntries divided = DivideIntoBuckets(LocateAll(points, voxel_size));
  const size_t buckets = divided.begins.size() - 1;
  std::vector<size_t> voxels(buckets);  // how many, then the place of the first one in the result
  tbb::parallel_for(size_t{0}, buckets, [&](size_t bucket) {
    VoxelEntry* begin = divided.entries.data() + divided.begins[bucket];
    VoxelEntry* end = divided.entries.data() + divided.begins[bucket + 1];
    if (static_cast<size_t>(end - begin) > kParallelSort) {
      tbb::parallel_sort(begin, end);
    } else {
      std::sort(begin, end);
    }
    ForEachVoxel(begin, end, [&](const VoxelEntry*, const VoxelEntry*) { ++voxels[bucket]; });
  });
  size_t count = 0;
  for (size_t& place : voxels) count += std::exchange(place, count);
  PointCloud means(count);
  tbb::parallel_for(size_t{0}, buckets, [&](size_t bucket) {
    const VoxelEntry* entries = divided.entries.data() + divided.begins[bucket];
    const VoxelEntry* entries_end = divided.entries.data() + divided.begins[bucket + 1];
    // Moved once and through memory: GCC 12 may leave out the rounding to float32 where it keeps them in registers.
    PointCloud members(static_cast<size_t>(entries_end - entries));
    std::transform(entries, entries_end, members.begin(), [&](const VoxelEntry& e) { return points[e.point]; });
    SurfacePoint* mean = means.data() + voxels[bucket];
    ForEachVoxel(entries, entries_end, [&](const VoxelEntry* begin, const VoxelEntry* end) {
      *mean++ = AverageVoxel(members.data() + (begin - entries), members.data() + (end - entries));
    });
  });
  return means;
}

}  // namespace

PointCloud VoxelFilter(const PointCloud& points, float voxel_size) {
  return AverageVoxels(PlainPoints(points), voxel_size);
}

PointCloud MergeClouds(const std::vector<PlacedCloud>& clouds, float voxel_size) {
  return AverageVoxels(PlacedPoints(clouds), voxel_size);
}

}  // namespace acmp
