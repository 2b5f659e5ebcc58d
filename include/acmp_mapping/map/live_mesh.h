#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/mesh/distance_volume.h"

namespace acmp {

struct LiveMeshOptions {
  size_t max_bytes = 250000000;  ///< of all voxels; where they need more, they become larger
  /// Of an update; but it has at least one block, of at most 196,608 (a wall has 3,000).
  size_t max_triangles = 50000;
  double max_seconds = 0.1;  ///< of an update; but each kind of work that waits is done for one keyframe or block
};

/// What has changed of a mesh. Blocks are told by numbers that stay the same as long as there is something in them.
struct MeshUpdate {
  struct Block {
    int number = 0;
    TriangleMesh mesh;  ///< local coordinates; no triangles: what was there is gone
  };
  bool anew = false;  ///< whatever was told before is gone
  std::vector<Block> blocks;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< of the local coordinates, in the world
};

struct LiveMeshStatistics {
  size_t keyframes = 0;         ///< in it
  size_t keyframes_to_add = 0;  ///< in the map, and not yet in it
  size_t blocks = 0;            ///< that were told
  size_t triangles = 0;         ///< of these
  size_t to_tell = 0;           ///< blocks that have changed since they were told
  size_t to_make_again = 0;     ///< blocks in which keyframes have moved, have other points or are gone
  double longest_wait_s = 0;    ///< of all these
  size_t bytes = 0;             ///< of its voxels
  double voxel_size = 0;        ///< 0: none yet
  double coarser = 1;           ///< so much larger than those of MakeMapMesh its voxels are, because of max_bytes
};

/// The mesh of a map (MakeMapMesh) while the map grows, in blocks (VolumeBlock). A keyframe that is new is added to the
/// volume at once. Where keyframes have changed, the blocks that they saw are made again, of all keyframes that see
/// them, beside the volume, and come in place of the old ones when they are whole. First comes what is near the newest
/// camera and what has waited long.
///
/// When nothing is left to do, the blocks together are the mesh of MakeMapMesh, but for three things: distances and
/// colours are averaged in another order, which changes their last bits (colours: of each view); keyframes that have
/// moved by less than kMovedVoxels are where they were; voxels keep their size a little longer (MeshVoxelSize), and are
/// larger where max_bytes asks for it. Used by one thread at a time.
class LiveMesh {
 public:
  /// With each new keyframe all others move a little (PlaceAlong).
  static constexpr double kMovedVoxels = 0.25;

  /// @param map outlives this
  LiveMesh(const MapStore* map, const LiveMeshOptions& options) : map_(map), options_(options) {}

  /// What has changed, most urgent first. The rest comes with the next calls: see HasWork.
  /// @param make_again false: only new keyframes are taken in, and what has changed is told
  MeshUpdate Update(bool make_again = true);
  /// Whether Update has something to do.
  /// @param make_again false: but for making blocks again
  bool HasWork(bool make_again = true) const;
  /// Has all blocks told again, for a new listener.
  void TellAll();
  /// Has the most urgent blocks that were told only once told again, for listeners who have lost something. False: all
  /// have been.
  /// @param count of blocks, at most
  bool Repeat(size_t count);
  /// Frees all memory. The next Update begins anew, whatever was told.
  void Clear();

  LiveMeshStatistics statistics() const;

 private:
  using Clock = std::chrono::steady_clock;
  using Since = std::optional<Clock::time_point>;
  struct Keyframe {
    PlacedKeyframe placed;            ///< as it is to be
    double spacing = 0;               ///< of its points, before they are scaled
    Since waits = Clock::now();       ///< since when it waits to be added; none: it is in the volume
    bool has_changed = false;         ///< since `blocks` were found
    std::vector<VolumeBlock> blocks;  ///< that it changes, sorted
  };
  struct Block {
    int number = 0;
    size_t triangles = 0;  ///< as told
    Since changed;         ///< since when it waits to be told
    Since once;            ///< since when it has been told only once
    bool repeats = false;  ///< it waits to be told again
    Since stale;           ///< since when it waits to be made again
  };
  /// Blocks that are being made again.
  struct Batch {
    std::vector<VolumeBlock> blocks;     ///< sorted
    Clock::time_point since;             ///< when the first of them began to wait
    std::vector<KeyframeKey> keyframes;  ///< that are not in it yet, the first one last
    std::unique_ptr<DistanceVolume> volume;
  };

  /// Takes over what the map has, and marks what has changed. False: time was over, there is more.
  bool Read(Clock::time_point end);
  void ReadKeyframe(const PlacedKeyframe& placed, Keyframe* keyframe);
  void Restart(double voxel_size);
  // Each does one piece of work. False: there was none.
  bool AddKeyframe();
  bool MakeAgain();
  void StartBatch();
  void AddToBatch(Keyframe* keyframe);
  void FinishBatch();
  bool Tell(size_t max_triangles, MeshUpdate* update);
  void Mark(Since Block::*since, const std::vector<VolumeBlock>& blocks);
  /// Of blocks that wait, sorted by urgency.
  std::vector<VolumeBlock> MostUrgent(Since Block::*since, size_t count) const;
  size_t max_batch() const { return std::max<size_t>(1, options_.max_bytes / 4 / kFullBlockBytes); }
  DistanceVolumeOptions VolumeOptions() const;

  const MapStore* const map_;
  const LiveMeshOptions options_;
  std::optional<uint64_t> version_;  ///< of the map, as read; none: not (all) read yet
  double map_voxel_size_ = 0, voxel_size_ = 0, coarser_ = 1;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();  ///< of the local coordinates, in the world
  Eigen::Vector3d camera_ = Eigen::Vector3d::Zero();  ///< the newest one, local coordinates
  bool begins_anew_ = false;                          ///< the next update does
  std::map<KeyframeKey, Keyframe> keyframes_;
  std::map<VolumeBlock, Block> blocks_;
  int next_number_ = 0;
  std::unique_ptr<DistanceVolume> volume_;  ///< none: nothing is in it
  std::optional<Batch> batch_;
};

}  // namespace acmp
