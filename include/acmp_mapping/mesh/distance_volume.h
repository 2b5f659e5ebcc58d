#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/posed_camera.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// What one image knows of surfaces; the pixels belong to the caller. All maps have the camera's size.
struct SurfaceView {
  PosedCamera camera;
  ImageView<const float> depth;       ///< z, 0 = unknown
  ImageView<const Vec3f> normal;      ///< camera's frame, facing the camera; 0 = unknown: as if facing it squarely
  ImageView<const float> confidence;  ///< 0..1; 0 = unknown
  ImageView<const Rgb> color;         ///< may be empty: black
};

struct DistanceVolumeOptions {
  double voxel_size = 0;     ///< unit of the poses, > 0
  size_t max_bytes = 0;      ///< of all voxels, > 0
  float min_confidence = 0;  ///< pixels below take no part, 0..1
};

/// Distances are known so many voxels before and behind a surface.
constexpr double kTruncationVoxels = 3;

/// Of pixels that should make a mesh.
constexpr float kMinMeshConfidence = 0.4f;

/// Bytes of a voxel: distance, weight and colour.
constexpr size_t kVoxelBytes = 12;

/// A cube of space with kBlockVoxels voxels along each axis. Numbers of cubes from the origin; cube 0 begins at voxel
/// 0.
using VolumeBlock = std::array<int, 3>;
constexpr int kBlockVoxels = 32;
/// Bytes of a block all of whose voxels take memory.
constexpr size_t kFullBlockBytes = kVoxelBytes * kBlockVoxels * kBlockVoxels * kBlockVoxels;

/// Voxels take more memory than they may, or more than 2^30 of them lie between a surface and the origin.
class VoxelsTooSmallError : public InvalidInputError {
 public:
  using InvalidInputError::InvalidInputError;
};

/// The signed distance to the surfaces that images see, positive in front of them, in a narrow band around them
/// (Curless and Levoy 1996). In the world's frame. Of each voxel that falls on a pixel, the distance to the pixel's
/// plane is averaged with those of other images, weighted by confidence, by the cosine between ray and normal, and,
/// where a pixel is larger than a voxel, by the share of it that a voxel is. Voxels that no image sees near a surface
/// take no memory (OpenVDB, in blocks of 8 x 8 x 8).
///
/// The same views in the same order give the same bits, however many threads there are.
class DistanceVolume {
 public:
  /// Throws InvalidInputError for options out of bounds.
  explicit DistanceVolume(const DistanceVolumeOptions& options);
  ~DistanceVolume();
  DistanceVolume(const DistanceVolume&) = delete;
  DistanceVolume& operator=(const DistanceVolume&) = delete;

  /// Throws InvalidInputError for maps that do not fit the camera and a pose that is not rigid, VoxelsTooSmallError
  /// when the view's surfaces would take more than max_bytes, or lie farther than 2^30 voxels from the origin: then it
  /// is as if the view had not been given.
  /// @param only if given: sorted blocks, all others stay as they are
  /// @return sorted: the blocks that the view's surfaces lie in, also others than `only`, and those beside them whose
  /// surface changes with theirs
  std::vector<VolumeBlock> Integrate(const SurfaceView& view,
                                     const std::optional<std::vector<VolumeBlock>>& only = std::nullopt);

  /// Takes these blocks from another volume of the same voxel size, which loses them, in place of its own. Throws
  /// VoxelsTooSmallError, and changes nothing, when all would take more than max_bytes.
  void Replace(const std::vector<VolumeBlock>& blocks, DistanceVolume* from);

  /// The surface where the distance is 0, within cells whose corners all were seen: without a back, and open where
  /// nobody looked. A vertex has the colour of the voxels around it, and the confidence w / (1 + w) of their weight w.
  /// Empty where nothing was integrated. Throws InvalidInputError for a mesh of 2^31 vertices or more.
  TriangleMesh ExtractMesh() const;
  /// Of each block the triangles of ExtractMesh whose centroid is in it: those of all blocks together are the whole
  /// mesh, none twice. Vertices that several blocks have are the same in each but for the normal's last bits.
  std::vector<TriangleMesh> ExtractBlocks(const std::vector<VolumeBlock>& blocks) const;

  bool HasVoxels(const VolumeBlock& block) const;  ///< that take memory
  size_t voxels() const;                           ///< all that do
  size_t bytes() const { return voxels() * kVoxelBytes; }

 private:
  struct Grids;
  /// Throws VoxelsTooSmallError when more leaves than now would take more than max_bytes.
  void CheckMemory(size_t leaves) const;

  const DistanceVolumeOptions options_;
  std::unique_ptr<Grids> grids_;
};

/// Voxels of a mesh by default: so many pixels wide where a surface is at the median depth. Noise of depth is larger
/// than a pixel, so that smaller voxels only make more triangles.
constexpr double kVoxelPixels = 2.5;

/// What a pixel covers at the map's median depth, unit of the depths. 0 for a map without depth.
double MedianFootprint(const PinholeCamera& camera, const ImageView<const float>& depth);

/// kVoxelPixels of the median footprint. Throws InvalidInputError when none is positive.
double DefaultVoxelSize(std::vector<double> footprints);

}  // namespace acmp
