#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"

namespace acmp {

/// A run's points in cubic tiles of the scene's frame. OUTPUT/tiles/X_Y_Z.ply has those whose coordinates divided by
/// the tile size, rounded down, are X, Y and Z, in the order in which they came. OUTPUT/tiles/index.json lists the
/// files. Points wait in memory up to a number of bytes, beyond in one work file, so that a cloud of any size can be
/// cut. By one thread at a time.
class TiledCloud {
 public:
  static constexpr size_t kMaxTiles = 1000000;
  static constexpr int64_t kMaxTileNumber = int64_t{1} << 53;  ///< of X, Y, Z: double has all whole numbers up to it

  static constexpr const char* kFolder = "tiles";  ///< in OUTPUT, and of the work file
  static constexpr const char* kIndexName = "index.json";

  /// @param folder outlives this
  /// @param tile_size scene units, positive and finite
  /// @param max_bytes of points in memory; at least one point is held. Each tile takes some 150 bytes besides
  /// @param origin of the points' coordinates, which is added (WritePly)
  TiledCloud(const OutputFolder* folder, double tile_size, size_t max_bytes,
             const Eigen::Vector3d& origin = Eigen::Vector3d::Zero());

  /// Adds points after all that came before. Throws InvalidInputError for a tile size so small that a tile's number is
  /// not within +-kMaxTileNumber, or that there are more than kMaxTiles tiles; ProcessingError when the work file
  /// cannot be written.
  void Add(const PointCloud& points);

  /// Writes the tiles, each whole or absent, and then the index; once. Throws Interrupted, and ProcessingError when the
  /// work file cannot be read or a file cannot be written.
  void Commit(const StopRequest& interrupt);

  size_t points() const { return points_; }
  size_t tiles() const { return tiles_.size(); }

 private:
  using TileNumber = std::array<int64_t, 3>;
  static constexpr uint64_t kNoBlock = std::numeric_limits<uint64_t>::max();

  /// All points of a tile: those in the work file, a chain of blocks, come before those in memory.
  struct Tile {
    size_t points = 0;
    Vec3f min, max;  ///< of the positions, before the origin is added
    PointCloud in_memory;
    uint64_t last_block = kNoBlock;  ///< place in the work file
  };

  TileNumber NumberOf(const Vec3f& position) const;
  Tile* TileOf(const Vec3f& position);
  /// Moves all points in memory to the work file.
  void MoveToFile();
  void WriteTile(const std::filesystem::path& path, const Tile& tile);
  /// Reads a block of a tile, and where the one before it is.
  PointCloud ReadBlock(uint64_t* place);
  void WriteIndex() const;

  std::filesystem::path FolderOfTiles() const { return folder_.path() / kFolder; }

  const OutputFolder& folder_;
  const double tile_size_;
  const size_t max_points_;
  const Eigen::Vector3d origin_;

  std::map<TileNumber, Tile> tiles_;
  TileNumber last_number_ = {};
  Tile* last_tile_ = nullptr;  ///< that of last_number_, most often the next one, too
  size_t points_ = 0, in_memory_ = 0;

  std::optional<AtomicFile>
      file_;  ///< never committed: it goes with this, and what a killed process left is used again
  std::ifstream reader_;
  uint64_t file_bytes_ = 0;
};

/// Where a run's cloud goes: OUTPUT/fused.ply, or with --tile-size OUTPUT/tiles. Errors are those of PlyFile and
/// TiledCloud.
class CloudOutput {
 public:
  /// @param run with a folder; outlives this
  explicit CloudOutput(const ReconstructRun& run);

  /// Whether places must be filled in their order, by one thread at a time; else by any threads at once.
  bool in_order() const { return tiles_ != nullptr; }
  /// Sets aside the places of so many points, after those of earlier calls. Returns the number of the first point. By
  /// one thread at a time.
  size_t Reserve(size_t points) { return file_ ? file_->Reserve(points) : tiles_->points(); }
  /// Fills places that were set aside. @param first number of the first point
  void WriteAt(size_t first, const PointCloud& points);
  /// Once all places are filled. Without it there is no cloud.
  void Commit();

  CloudSize size() const;

 private:
  const StopRequest& interrupt_;
  std::unique_ptr<PlyFile> file_;      ///< this one
  std::unique_ptr<TiledCloud> tiles_;  ///< or that one
};

/// Points of views that are fused and wait for their place in the cloud, which is known when all earlier views are
/// fused. In memory up to a number of bytes, beyond in files of the work folder, so that a scene of any size can be
/// fused (but COLMAP's model keeps all points). For any number of threads.
class WaitingClouds {
 public:
  /// @param folder outlives this
  WaitingClouds(const OutputFolder* folder, size_t max_bytes) : folder_(*folder), max_bytes_(max_bytes) {}

  /// Keeps a view's points; once per view. Throws ProcessingError when their file cannot be written.
  void Put(int index, PointCloud cloud);
  /// How many they are, until they are handed out.
  size_t NumPoints(int index) const;
  /// Hands them out, once. Throws ProcessingError when their file cannot be read.
  PointCloud Take(int index);

 private:
  std::filesystem::path FileOf(int index) const { return folder_.WorkFile("points", index); }

  const OutputFolder& folder_;
  const size_t max_bytes_;

  mutable std::mutex mutex_;  ///< of what follows
  struct Waiting {
    size_t points = 0;
    PointCloud cloud;  ///< empty: in the view's file
  };
  std::map<int, Waiting> waiting_;
  size_t bytes_ = 0;  ///< in memory
};

}  // namespace acmp
