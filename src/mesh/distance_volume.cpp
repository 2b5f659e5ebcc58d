#include "acmp_mapping/mesh/distance_volume.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <utility>
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

/// A leaf of all trees: 8 x 8 x 8 voxels.
struct LeafVoxels {
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

/// Origins of the leaves that the view's bands go through, sorted.
std::vector<Coord> LeavesInBand(const SurfaceView& view, const DistanceVolumeOptions& options) {
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
          throw VoxelsTooSmallError(Concat("a surface lies more than 2^30 voxels of ", voxel,
                                           " from the origin: the voxel size must be larger"));
        }
        const Coord voxel_at = Coord::round(openvdb::Vec3d(index.x(), index.y(), index.z()));
        const Coord leaf = voxel_at & ~(kLeafSize - 1);
        if (leaf == last[sample]) continue;
        last[sample] = leaf;
        rows[row].push_back(leaf);
      }
    }
  });
  std::vector<Coord> leaves;
  for (const std::vector<Coord>& row : rows) leaves.insert(leaves.end(), row.begin(), row.end());
  tbb::parallel_sort(leaves.begin(), leaves.end());
  leaves.erase(std::unique(leaves.begin(), leaves.end()), leaves.end());
  return leaves;
}

/// Averages a view's distances and colours into a leaf's voxels.
class LeafUpdate {
 public:
  LeafUpdate(const SurfaceView& view, const DistanceVolumeOptions& options) : view_(view), options_(options) {}

  void operator()(const LeafVoxels& leaf) const {
    const RigidTransform& cam_from_world = view_.camera.cam_from_world;
    const Eigen::Vector3d origin(leaf.origin.x(), leaf.origin.y(), leaf.origin.z());
    const Eigen::Vector3f first = (cam_from_world * (options_.voxel_size * origin)).cast<float>();
    const Eigen::Matrix3f step = (options_.voxel_size * cam_from_world.linear()).cast<float>();
    size_t i = 0;
    for (int x = 0; x < kLeafSize; ++x) {
      for (int y = 0; y < kLeafSize; ++y) {
        for (int z = 0; z < kLeafSize; ++z, ++i) {
          const Eigen::Vector3f at(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
          Update(first + step * at, leaf.distance + i, leaf.weight + i, leaf.color + i);
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

/// Of the block in which a voxel lies.
VolumeBlock BlockOf(const Coord& voxel) {
  const auto cube = [](int at) { return at >= 0 ? at / kBlockVoxels : -((kBlockVoxels - 1 - at) / kBlockVoxels); };
  return {cube(voxel.x()), cube(voxel.y()), cube(voxel.z())};
}

/// Blocks whose surface is another one when these leaves (origins) have changed, as far as they are in the tree: a
/// triangle hangs on voxels around it.
std::vector<VolumeBlock> BlocksAround(const std::vector<Coord>& leaves, const FloatTree& tree) {
  constexpr int kReach = 2;  // voxels, from a triangle to those of its cells
  constexpr int kOffsets[] = {0, -kReach, kLeafSize - 1 + kReach};
  std::vector<VolumeBlock> blocks;
  for (const Coord& leaf : leaves) {
    const VolumeBlock own = BlockOf(leaf);
    if (blocks.empty() || blocks.back() != own) blocks.push_back(own);
    for (int i = 1; i < 27; ++i) {
      const Coord beside = leaf.offsetBy(kOffsets[i % 3], kOffsets[i / 3 % 3], kOffsets[i / 9]);
      const VolumeBlock block = BlockOf(beside);
      if (block != own && tree.probeConstLeaf(beside)) blocks.push_back(block);
    }
  }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  blocks.shrink_to_fit();  // somebody keeps it, and it was a thousand times as long
  return blocks;
}

/// Calls for the origin of each leaf that a block has room for, and of those that touch it where `margin` is 1.
template <class Function>
void ForEachLeaf(const VolumeBlock& block, int margin, const Function& function) {
  constexpr int kLeaves = kBlockVoxels / kLeafSize;
  for (int x = -margin; x < kLeaves + margin; ++x) {
    for (int y = -margin; y < kLeaves + margin; ++y) {
      for (int z = -margin; z < kLeaves + margin; ++z) {
        function(Coord(block[0] * kBlockVoxels + x * kLeafSize, block[1] * kBlockVoxels + y * kLeafSize,
                       block[2] * kBlockVoxels + z * kLeafSize));
      }
    }
  }
}

template <class Tree>
void ReplaceLeaf(const Coord& origin, Tree* from, Tree* tree) {
  using Leaf = typename Tree::LeafNodeType;
  delete tree->template stealNode<Leaf>(origin, tree->background(), false);
  if (Leaf* leaf = from->template stealNode<Leaf>(origin, from->background(), false)) tree->addLeaf(leaf);
}

/// Shares a mesh's triangles out among blocks by their centroids; what lies in none of them is left out.
std::vector<TriangleMesh> CutIntoBlocks(const TriangleMesh& whole, const std::vector<VolumeBlock>& blocks) {
  std::map<VolumeBlock, size_t> places;
  for (size_t i = 0; i < blocks.size(); ++i) places[blocks[i]] = i;
  std::vector<TriangleMesh> meshes(blocks.size());
  for (const auto& triangle : whole.triangles) {
    const auto corner = [&](int i) { return whole.vertices[triangle[i]].position; };
    const Vec3f sum = corner(0) + corner(1) + corner(2);
    const auto cell = [](float value) { return static_cast<int>(std::floor(value / 3)); };
    const auto place = places.find(BlockOf({cell(sum.x), cell(sum.y), cell(sum.z)}));
    if (place != places.end()) meshes[place->second].triangles.push_back(triangle);
  }
  constexpr auto kNone = std::numeric_limits<uint32_t>::max();
  std::vector<uint32_t> renumbered(whole.vertices.size(), kNone);
  for (TriangleMesh& mesh : meshes) {
    std::vector<uint32_t> used;
    for (auto& triangle : mesh.triangles) {
      for (uint32_t& corner : triangle) {
        if (renumbered[corner] == kNone) {
          renumbered[corner] = static_cast<uint32_t>(used.size());
          used.push_back(corner);
          mesh.vertices.push_back(whole.vertices[corner]);
        }
        corner = renumbered[corner];
      }
    }
    for (uint32_t corner : used) renumbered[corner] = kNone;
  }
  return meshes;
}

void ScaleVertices(double factor, TriangleMesh* mesh) {
  for (SurfacePoint& vertex : mesh->vertices) vertex.position = static_cast<float>(factor) * vertex.position;
}

std::string Megabytes(size_t bytes) { return Concat(std::ceil(static_cast<double>(bytes) / 1e6), " MB"); }

}  // namespace

DistanceVolume::DistanceVolume(const DistanceVolumeOptions& options)
    : options_(options), grids_(std::make_unique<Grids>()) {
  CheckVolumeOptions(options);
}

DistanceVolume::~DistanceVolume() = default;

bool DistanceVolume::HasVoxels(const VolumeBlock& block) const {
  bool any = false;
  ForEachLeaf(block, 0, [&](const Coord& origin) { any = any || grids_->weight.probeConstLeaf(origin); });
  return any;
}

size_t DistanceVolume::voxels() const { return grids_->weight.leafCount() * kLeafVoxels; }

std::vector<VolumeBlock> DistanceVolume::Integrate(const SurfaceView& view,
                                                   const std::optional<std::vector<VolumeBlock>>& only) {
  CheckSurfaceView(view);
  const std::vector<Coord> all = LeavesInBand(view, options_);
  std::vector<Coord> origins;
  std::copy_if(all.begin(), all.end(), std::back_inserter(origins), [&](const Coord& leaf) {
    return !only || std::binary_search(only->begin(), only->end(), BlockOf(leaf));
  });
  const auto added = std::count_if(origins.begin(), origins.end(),
                                   [&](const Coord& origin) { return !grids_->weight.probeConstLeaf(origin); });
  CheckMemory(grids_->weight.leafCount() + static_cast<size_t>(added));
  std::vector<LeafVoxels> leaves;
  leaves.reserve(origins.size());
  for (const Coord& origin : origins) {
    FloatTree::LeafNodeType* distance = grids_->distance.touchLeaf(origin);
    distance->setValuesOn();  // VolumeToMesh looks at active voxels only
    leaves.push_back({origin, distance->buffer().data(), grids_->weight.touchLeaf(origin)->buffer().data(),
                      grids_->color.touchLeaf(origin)->buffer().data()});
  }
  const LeafUpdate update(view, options_);
  tbb::parallel_for(size_t{0}, leaves.size(), [&](size_t i) { update(leaves[i]); });
  return BlocksAround(all, grids_->weight);
}

void DistanceVolume::CheckMemory(size_t leaves) const {
  const size_t needed = leaves * kLeafVoxels * kVoxelBytes;
  if (needed <= options_.max_bytes) return;
  throw VoxelsTooSmallError(Concat("the mesh's voxels of ", options_.voxel_size, " take ", Megabytes(needed),
                                   ", more than the ", Megabytes(options_.max_bytes),
                                   " that they may: the voxel size must be larger"));
}

void DistanceVolume::Replace(const std::vector<VolumeBlock>& blocks, DistanceVolume* from) {
  size_t leaves = grids_->weight.leafCount();
  for (const VolumeBlock& block : blocks) {
    ForEachLeaf(block, 0, [&](const Coord& origin) {
      leaves += from->grids_->weight.probeConstLeaf(origin) ? 1 : 0;
      leaves -= grids_->weight.probeConstLeaf(origin) ? 1 : 0;
    });
  }
  CheckMemory(leaves);
  for (const VolumeBlock& block : blocks) {
    ForEachLeaf(block, 0, [&](const Coord& origin) {
      ReplaceLeaf(origin, &from->grids_->distance, &grids_->distance);
      ReplaceLeaf(origin, &from->grids_->weight, &grids_->weight);
      ReplaceLeaf(origin, &from->grids_->color, &grids_->color);
    });
  }
}

TriangleMesh DistanceVolume::ExtractMesh() const {
  TriangleMesh mesh = ExtractMeshInVoxels(grids_->distance, grids_->weight, grids_->color);
  ScaleVertices(options_.voxel_size, &mesh);
  return mesh;
}

std::vector<TriangleMesh> DistanceVolume::ExtractBlocks(const std::vector<VolumeBlock>& blocks) const {
  FloatTree around(grids_->distance.background());
  for (const VolumeBlock& block : blocks) {
    ForEachLeaf(block, 1, [&](const Coord& origin) {
      const auto* leaf = grids_->distance.probeConstLeaf(origin);
      if (leaf && !around.probeConstLeaf(origin)) around.addLeaf(new FloatTree::LeafNodeType(*leaf));
    });
  }
  auto meshes = CutIntoBlocks(ExtractMeshInVoxels(around, grids_->weight, grids_->color), blocks);
  for (TriangleMesh& mesh : meshes) ScaleVertices(options_.voxel_size, &mesh);
  return meshes;
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
