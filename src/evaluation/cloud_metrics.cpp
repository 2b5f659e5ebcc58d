#include "acmp_mapping/evaluation/cloud_metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>

#include <tbb/parallel_for.h>
#include <nanoflann.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/match_pixel.h"

namespace acmp {
namespace {

// What nanoflann asks of a point set. In double: distances to boxes and to the points in them must not differ by what
// single precision rounds.
struct PointSet {
  const PointCloud& points;

  size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(size_t index, size_t axis) const {
    const Vec3f& p = points[index].position;
    return axis == 0 ? p.x : axis == 1 ? p.y : p.z;
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
using Distance = nanoflann::L2_Simple_Adaptor<double, PointSet, double>;
using KdTree = nanoflann::KDTreeSingleIndexAdaptor<Distance, PointSet, 3, size_t>;

// What nanoflann's search asks of a result: the distance to the nearest point. Others that are just as near, but for
// rounding, are not looked at: a cloud may have very many equal points.
class NearestDistance {
 public:
  using DistanceType = double;

  bool addPoint(double squared, size_t /*index*/) {
    if (squared < squared_) squared_ = squared;
    return true;
  }
  double worstDist() const {
    constexpr double kRounding = 1e-14;  // relative: some thirty sums and products on the way down the tree
    return squared_ > 0 ? (1 - kRounding) * squared_ : -1;
  }
  size_t size() const { return full() ? 1 : 0; }
  bool full() const { return squared_ < std::numeric_limits<double>::max(); }
  bool empty() const { return !full(); }
  void sort() {}

  double squared() const { return squared_; }

 private:
  double squared_ = std::numeric_limits<double>::max();
};

// Squared distance of each of `points` to the nearest of `targets`, which must not be empty.
std::vector<double> SquaredDistances(const PointCloud& points, const PointCloud& targets) {
  const PointSet set{targets};
  constexpr size_t kPointsPerLeaf = 16;
  KdTree tree(3, set, {kPointsPerLeaf});
  tree.buildIndex();
  std::vector<double> squared(points.size());
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t i) {
    const Vec3f& p = points[i].position;
    const double query[3] = {p.x, p.y, p.z};
    NearestDistance nearest;
    tree.findNeighbors(nearest, query, {});
    squared[i] = nearest.squared();
  });
  return squared;
}

// Number of each point's voxel, counted from 0 in the order of first appearance.
struct VoxelGrid {
  VoxelGrid(const PointCloud& points, double voxel_size, double shift) {
    std::unordered_map<Voxel, size_t, VoxelHash> index;
    voxel_of_point.reserve(points.size());
    for (const SurfacePoint& point : points) {
      const size_t number = index.emplace(VoxelOf(point.position, voxel_size, shift), index.size()).first->second;
      if (number == point_count.size()) point_count.push_back(0);
      ++point_count[number];
      voxel_of_point.push_back(number);
    }
  }

  // Sum over voxels of the share of points within the distance.
  double SumOfShares(const std::vector<double>& squared_distances, double threshold) const {
    std::vector<size_t> within(point_count.size());
    for (size_t i = 0; i < voxel_of_point.size(); ++i) {
      if (squared_distances[i] <= threshold * threshold) ++within[voxel_of_point[i]];
    }
    double sum = 0;
    for (size_t v = 0; v < within.size(); ++v) sum += static_cast<double>(within[v]) / point_count[v];
    return sum;
  }

  std::vector<size_t> voxel_of_point;
  std::vector<size_t> point_count;
};

// Per threshold, the percentage of `points` within it of `targets`, averaged over the voxels of both grids.
std::vector<double> SharesWithin(const PointCloud& points, const PointCloud& targets,
                                 const std::vector<double>& thresholds, double voxel_size) {
  if (points.empty() || targets.empty()) return std::vector<double>(thresholds.size(), 0.0);
  const std::vector<double> squared_distances = SquaredDistances(points, targets);
  const VoxelGrid grid(points, voxel_size, 0.0);
  const VoxelGrid shifted_grid(points, voxel_size, 0.5);
  const size_t voxels = grid.point_count.size() + shifted_grid.point_count.size();
  std::vector<double> shares;
  for (const double threshold : thresholds) {
    const double sum =
        grid.SumOfShares(squared_distances, threshold) + shifted_grid.SumOfShares(squared_distances, threshold);
    shares.push_back(100.0 * sum / voxels);
  }
  return shares;
}

void CheckCloud(const char* name, const PointCloud& points, double voxel_size) {
  for (size_t i = 0; i < points.size(); ++i) {
    const Vec3f& p = points[i].position;
    if (FitsVoxels(p, voxel_size)) continue;
    throw InvalidInputError(Concat(name, ": point ", i, " = (", p.x, ", ", p.y, ", ", p.z,
                                   "): coordinates must be finite and at most ", kMaxVoxels, " voxels from 0"));
  }
}

// Those with a mark.
PointCloud Select(const PointCloud& points, const std::vector<uint8_t>& marks) {
  PointCloud selected;
  for (size_t i = 0; i < points.size(); ++i) {
    if (marks[i]) selected.push_back(points[i]);
  }
  return selected;
}

/// Into how many parts each edge of a triangle is cut.
double PartsOf(const TriangleMesh& mesh, const std::array<uint32_t, 3>& triangle, double spacing) {
  double longest = 0;
  for (int i = 0; i < 3; ++i) {
    const Vec3f edge = mesh.vertices[triangle[i]].position - mesh.vertices[triangle[(i + 1) % 3]].position;
    longest = std::max<double>(longest, Norm(edge));
  }
  return std::max(1.0, std::ceil(longest / spacing));
}

}  // namespace

std::vector<CloudMetrics> EvaluateCloud(const PointCloud& reconstruction, const PointCloud& ground_truth,
                                        const std::vector<double>& thresholds, double voxel_size,
                                        const std::vector<uint8_t>& observed) {
  CheckPositive("voxel size", voxel_size);
  for (const double threshold : thresholds) CheckPositive("threshold", threshold);
  if (ground_truth.empty()) throw InvalidInputError("ground truth: 0 points: must be at least 1");
  CheckCloud("reconstruction", reconstruction, voxel_size);
  CheckCloud("ground truth", ground_truth, voxel_size);
  if (!observed.empty() && observed.size() != reconstruction.size()) {
    throw InvalidInputError(
        Concat("observed: ", observed.size(), " marks: must be one per point, ", reconstruction.size()));
  }

  const std::vector<double> accuracy =
      observed.empty() ? SharesWithin(reconstruction, ground_truth, thresholds, voxel_size)
                       : SharesWithin(Select(reconstruction, observed), ground_truth, thresholds, voxel_size);
  const std::vector<double> completeness = SharesWithin(ground_truth, reconstruction, thresholds, voxel_size);
  std::vector<CloudMetrics> metrics;
  for (size_t i = 0; i < thresholds.size(); ++i) {
    const double sum = accuracy[i] + completeness[i];
    const double f1 = sum > 0 ? 2.0 * accuracy[i] * completeness[i] / sum : 0.0;
    metrics.push_back({thresholds[i], accuracy[i], completeness[i], f1});
  }
  return metrics;
}

ObservedSurface::ObservedSurface(const PointCloud& reconstruction, double spacing, double tolerance)
    : reconstruction_(reconstruction), spacing_(spacing), tolerance_(tolerance), observed_(reconstruction.size()) {
  CheckPositive("spacing", spacing);
  CheckPositive("tolerance", tolerance);
  CheckCloud("reconstruction", reconstruction, spacing);
}

void ObservedSurface::Add(const DepthMap& depth, const PinholeCamera& camera, const RigidTransform& cam_from_world) {
  CheckSize("depth map", depth.width(), depth.height(), camera);
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
      if (occupied_.insert(VoxelOf(point.position, spacing_, 0.0)).second) cloud_.push_back(point);
    }
  }
}

void ObservedSurface::MarkObserved(const DepthMap& depth, const PinholeCamera& camera,
                                   const RigidTransform& cam_from_world) {
  tbb::parallel_for(size_t{0}, reconstruction_.size(), [&](size_t i) {
    if (observed_[i]) return;
    const Vec3f& p = reconstruction_[i].position;
    const Eigen::Vector3d in_cam = cam_from_world * Eigen::Vector3d(p.x, p.y, p.z);
    const auto pixel = camera.PixelOf(in_cam);
    const float z = pixel ? depth(pixel->x(), pixel->y()) : 0;
    if (IsKnown(z) && in_cam.z() <= z + tolerance_) observed_[i] = 1;
  });
}

PointCloud SampleMesh(const TriangleMesh& mesh, double spacing) {
  CheckPositive("spacing", spacing);
  double count = 0;
  for (const auto& triangle : mesh.triangles) count += std::pow(PartsOf(mesh, triangle, spacing), 2);
  if (!(count < std::numeric_limits<int32_t>::max())) {
    throw InvalidInputError(Concat("the mesh has ", count, " points ", spacing, " apart: must be below 2^31"));
  }
  PointCloud points;
  points.reserve(static_cast<size_t>(count));
  for (const auto& triangle : mesh.triangles) {
    const SurfacePoint& corner = mesh.vertices[triangle[0]];
    const Vec3f u = mesh.vertices[triangle[1]].position - corner.position;
    const Vec3f v = mesh.vertices[triangle[2]].position - corner.position;
    const int parts = static_cast<int>(PartsOf(mesh, triangle, spacing));
    const auto add = [&](double a, double b) {
      SurfacePoint point = corner;
      point.position = corner.position + static_cast<float>(a / parts) * u + static_cast<float>(b / parts) * v;
      points.push_back(point);
    };
    for (int i = 0; i < parts; ++i) {
      for (int j = 0; i + j < parts; ++j) {
        add(i + 1.0 / 3, j + 1.0 / 3);
        if (i + j + 1 < parts) add(i + 2.0 / 3, j + 2.0 / 3);
      }
    }
  }
  return points;
}

}  // namespace acmp
