#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/reconstruction/stop_request.h"
#include "output_folder.h"

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

}  // namespace acmp
