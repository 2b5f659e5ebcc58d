#include "acmp_mapping/mesh/distance_volume.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/keyframe/frame.h"
#include "distance_grids.h"

namespace acmp {
namespace {

using openvdb::Coord;

constexpr auto kTruncation = static_cast<float>(kTruncationVoxels);
constexpr int kLeafSize = FloatTree::LeafNodeType::DIM;  ///< voxels
constexpr size_t kLeafVoxels = FloatTree::LeafNodeType::SIZE;
constexpr double kMaxIndex = 1 << 30;

/// A block of voxels in all trees.
struct Block {
  Coord origin;
  float* distance;
  float* weight;
  int32_t* color;
};

/// A view's plane at a pixel.
struct PixelPlane {
  Eigen::Vector3f normal;  ///< unit, camera's frame
  Eigen::Vector3f point;
  float cosine;  ///< between the normal and the ray back to the camera
};

PixelPlane PlaneAt(const SurfaceView& view, int col, int row) {
  PixelPlane plane;
  plane.point = view.camera.camera.Unproject({col, row}, view.depth(col, row)).cast<float>();
  const Eigen::Vector3f to_camera = -plane.point.normalized();
  const Vec3f& n = view.normal(col, row);
  plane.normal = {n.x, n.y, n.z};
  if (plane.normal.isZero()) plane.normal = to_camera;
  plane.cosine = plane.normal.dot(to_camera);
  return plane;
}

/// Half the length of the band along the ray, voxels: longer where the ray is slanted, so that the band is thick
/// enough.
float BandReach(float cosine) {
  constexpr float kLeastCosine = 0.5f;
  return kTruncation / std::max(cosine, kLeastCosine);
}

bool TakesPart(const SurfaceView& view, int col, int row, float min_confidence) {
  const float depth = view.depth(col, row), confidence = view.confidence(col, row);
  return depth > 0 && std::isfinite(depth) && confidence > 0 && confidence >= min_confidence;
}

/// Origins of the blocks that the view's bands go through, sorted.
std::vector<Coord> BlocksInBand(const SurfaceView& view, const DistanceVolumeOptions& options) {
  const RigidTransform world_from_cam = view.camera.cam_from_world.inverse();
  const double voxel = options.voxel_size;
  constexpr int kSamples = 7;  // along a ray: two voxels apart at most
  std::vector<std::vector<Coord>> rows(static_cast<size_t>(view.depth.height));
  tbb::parallel_for(size_t{0}, rows.size(), [&](size_t row) {
    Coord last[kSamples];
    std::fill(last, last + kSamples, Coord::max());
    for (int col = 0; col < view.depth.width; ++col) {
      if (!TakesPart(view, col, static_cast<int>(row), options.min_confidence)) continue;
      const PixelPlane plane = PlaneAt(view, col, static_cast<int>(row));
      if (plane.cosine <= 0) continue;
      const Eigen::Vector3d point = plane.point.cast<double>();
      const double reach = BandReach(plane.cosine) * voxel / point.norm();
      for (int sample = 0; sample < kSamples; ++sample) {
        const double along = 1 + reach * (2.0 * sample / (kSamples - 1) - 1);
        const Eigen::Vector3d index = (world_from_cam * (along * point)) / voxel;
        if (!(index.cwiseAbs().maxCoeff() < kMaxIndex)) {
          throw InvalidInputError(Concat("a surface lies more than 2^30 voxels of ", voxel,
                                         " from the origin: the voxel size must be larger"));
        }
        const Coord voxel_at = Coord::round(openvdb::Vec3d(index.x(), index.y(), index.z()));
        const Coord block = voxel_at & ~(kLeafSize - 1);
        if (block == last[sample]) continue;
        last[sample] = block;
        rows[row].push_back(block);
      }
    }
  });
  std::vector<Coord> blocks;
  for (const std::vector<Coord>& row : rows) blocks.insert(blocks.end(), row.begin(), row.end());
  tbb::parallel_sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

/// Averages a view's distances and colours into a block's voxels.
class BlockUpdate {
 public:
  BlockUpdate(const SurfaceView& view, const DistanceVolumeOptions& options) : view_(view), options_(options) {}

  void operator()(const Block& block) const {
    const RigidTransform& cam_from_world = view_.camera.cam_from_world;
    const Eigen::Vector3d origin(block.origin.x(), block.origin.y(), block.origin.z());
    const Eigen::Vector3f first = (cam_from_world * (options_.voxel_size * origin)).cast<float>();
    const Eigen::Matrix3f step = (options_.voxel_size * cam_from_world.linear()).cast<float>();
    size_t i = 0;
    for (int x = 0; x < kLeafSize; ++x) {
      for (int y = 0; y < kLeafSize; ++y) {
        for (int z = 0; z < kLeafSize; ++z, ++i) {
          const Eigen::Vector3f at(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
          Update(first + step * at, block.distance + i, block.weight + i, block.color + i);
        }
      }
    }
  }

 private:
  /// @param voxel its centre in the camera's frame
  void Update(const Eigen::Vector3f& voxel, float* distance, float* weight, int32_t* color) const {
    const PinholeCamera& camera = view_.camera.camera;
    const auto pixel = camera.PixelOf(voxel.cast<double>());
    if (!pixel) return;
    const int col = pixel->x(), row = pixel->y();
    if (!TakesPart(view_, col, row, options_.min_confidence)) return;
    const PixelPlane plane = PlaneAt(view_, col, row);
    if (plane.cosine <= 0) return;
    const auto size = static_cast<float>(options_.voxel_size);
    const float along_ray = (plane.point.norm() - voxel.norm()) / size;
    if (std::abs(along_ray) > BandReach(plane.cosine)) return;
    const float seen = plane.normal.dot(voxel - plane.point) / size;
    if (std::abs(seen) > kTruncation) return;
    const float added = Weight(plane, view_.confidence(col, row), seen);
    const float sum = *weight + added, share = added / sum;
    if (!(sum > 0)) return;
    *distance += share * (seen - *distance);
    *weight = sum;
    if (view_.color.empty()) return;
    const Eigen::Vector3f mean = UnpackColor(static_cast<uint32_t>(*color));
    *color = static_cast<int32_t>(PackColor(mean + share * (ToVector(view_.color(col, row)) - mean)));
  }

  float Weight(const PixelPlane& plane, float confidence, float distance) const {
    const double footprint = plane.point.z() / std::sqrt(view_.camera.camera.fx * view_.camera.camera.fy);
    const auto share = static_cast<float>(std::min(1.0, std::pow(options_.voxel_size / footprint, 2)));
    // What is behind a surface may be seen from the other side.
    const float behind = distance < -1 ? (kTruncation + distance) / (kTruncation - 1) : 1.0f;
    return confidence * plane.cosine * share * behind;
  }

  const SurfaceView& view_;
  const DistanceVolumeOptions& options_;
};

void CheckVolumeOptions(const DistanceVolumeOptions& options) {
  CheckRange("mesh_voxel_size", options.voxel_size, std::numeric_limits<float>::min() + 0.0, 1e9);
  if (options.max_bytes == 0) throw InvalidInputError("memory for the mesh's voxels = 0: must be > 0");
  CheckRange("min_confidence", options.min_confidence, 0.0f, 1.0f);
}

void CheckSurfaceView(const SurfaceView& view) {
  const PinholeCamera& camera = view.camera.camera;
  CheckCamera("camera", camera);
  CheckPose("cam_from_world", view.camera.cam_from_world);
  CheckSize("depth", view.depth.width, view.depth.height, camera);
  CheckSize("normal", view.normal.width, view.normal.height, camera);
  CheckSize("confidence", view.confidence.width, view.confidence.height, camera);
  if (!view.color.empty()) CheckSize("color", view.color.width, view.color.height, camera);
}

std::string Megabytes(size_t bytes) { return Concat(std::ceil(static_cast<double>(bytes) / 1e6), " MB"); }

}  // namespace

DistanceVolume::DistanceVolume(const DistanceVolumeOptions& options)
    : options_(options), grids_(std::make_unique<Grids>()) {
  CheckVolumeOptions(options);
}

DistanceVolume::~DistanceVolume() = default;

size_t DistanceVolume::voxels() const { return grids_->weight.leafCount() * kLeafVoxels; }

void DistanceVolume::Integrate(const SurfaceView& view) {
  CheckSurfaceView(view);
  const std::vector<Coord> origins = BlocksInBand(view, options_);
  const auto added = static_cast<size_t>(std::count_if(
      origins.begin(), origins.end(), [&](const Coord& origin) { return !grids_->weight.probeConstLeaf(origin); }));
  const size_t needed = bytes() + added * kLeafVoxels * kVoxelBytes;
  if (needed > options_.max_bytes) {
    throw InvalidInputError(Concat("the mesh's voxels of ", options_.voxel_size, " take ", Megabytes(needed),
                                   ", more than the ", Megabytes(options_.max_bytes),
                                   " that they may: the voxel size must be larger"));
  }
  std::vector<Block> blocks;
  blocks.reserve(origins.size());
  for (const Coord& origin : origins) {
    FloatTree::LeafNodeType* distance = grids_->distance.touchLeaf(origin);
    distance->setValuesOn();  // VolumeToMesh looks at active voxels only
    blocks.push_back({origin, distance->buffer().data(), grids_->weight.touchLeaf(origin)->buffer().data(),
                      grids_->color.touchLeaf(origin)->buffer().data()});
  }
  const BlockUpdate update(view, options_);
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t i) { update(blocks[i]); });
}

TriangleMesh DistanceVolume::ExtractMesh() const {
  TriangleMesh mesh = ExtractMeshInVoxels(grids_->distance, grids_->weight, grids_->color);
  for (SurfacePoint& vertex : mesh.vertices) {
    vertex.position = static_cast<float>(options_.voxel_size) * vertex.position;
  }
  return mesh;
}

double MedianFootprint(const PinholeCamera& camera, const ImageView<const float>& depth) {
  std::vector<float> known;
  for (int row = 0; row < depth.height; ++row) {
    for (int col = 0; col < depth.width; ++col) {
      if (depth(col, row) > 0) known.push_back(depth(col, row));
    }
  }
  return known.empty() ? 0.0 : Median(std::move(known)) / std::sqrt(camera.fx * camera.fy);
}

double DefaultVoxelSize(std::vector<double> footprints) {
  footprints.erase(std::remove_if(footprints.begin(), footprints.end(), [](double f) { return !(f > 0); }),
                   footprints.end());
  if (footprints.empty()) throw InvalidInputError("mesh: no image has depth, of which there could be a surface");
  return kVoxelPixels * Median(std::move(footprints));
}

}  // namespace acmp
