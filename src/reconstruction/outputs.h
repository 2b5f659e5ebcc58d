#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"

namespace acmp {

// OUTPUT/colmap, COLMAP's dense workspace with the maps of a run, for programs that fuse or mesh it. Images keep their
// names, and their folders below images/, depth_maps/ and normal_maps/.

/// All files of the COLMAP workspace, by name in OUTPUT.
std::set<std::string> ColmapFilesOf(const ReconstructRun& run);

/// Depth and normals where they were measured: pixels of kUnverifiedCost or worse have at most planes from around them,
/// and a program that fuses the maps would take them for what a camera saw.
void WriteColmapMaps(const ReconstructRun& run, int index, const FinalMaps& maps);

/// Cameras, poses, points of the cloud and the lists of images: last, since the online schedule decides late what gets
/// a map, and the maps tell which images see a point.
/// @param images with maps, by scene index
/// @param clouds of each of the images, from the plan's origin
void WriteColmapWorkspace(const ReconstructRun& run, const std::set<int>& images,
                          const std::vector<PointCloud>& clouds);

/// A run's points in cubic tiles of the scene's frame. OUTPUT/tiles/X_Y_Z.ply has those whose coordinates divided by
/// the tile size, rounded down, are X, Y and Z, in the order in which they came. OUTPUT/tiles/index.json lists the
/// files. Points wait in a work file for each tile, so that a cloud of any size can be cut. By one thread at a time.
class TiledCloud {
 public:
  static constexpr size_t kMaxTiles = 1000000;
  static constexpr int64_t kMaxTileNumber = int64_t{1} << 53;  ///< of X, Y, Z: double has all whole numbers up to it

  /// @param folder outlives this
  /// @param tile_size scene units, positive and finite
  /// @param origin of the points' coordinates, which is added (WritePly)
  TiledCloud(const OutputFolder* folder, double tile_size, const Eigen::Vector3d& origin = Eigen::Vector3d::Zero());

  /// Adds points after all that came before. Throws InvalidInputError for a tile size so small that a tile's number is
  /// not within +-kMaxTileNumber, or that there are more than kMaxTiles tiles; ProcessingError when a work file cannot
  /// be written.
  void Add(const PointCloud& points);

  /// Writes the tiles, each whole or absent, and then the index; once. Throws Interrupted, and ProcessingError when a
  /// work file cannot be read or a file cannot be written.
  void Commit(const StopRequest& interrupt);

  size_t points() const { return points_; }
  size_t tiles() const { return tiles_.size(); }

 private:
  using TileNumber = std::array<int64_t, 3>;

  struct Tile {
    size_t points = 0;
    Eigen::AlignedBox3f box;  ///< of the positions, before the origin is added
  };

  TileNumber NumberOf(const Vec3f& position) const;
  std::filesystem::path WorkFileOf(const TileNumber& number) const;
  void WriteTile(const TileNumber& number, const Tile& tile) const;
  void WriteIndex() const;

  const OutputFolder& folder_;
  const double tile_size_;
  const Eigen::Vector3d origin_;
  const std::filesystem::path tiles_folder_;
  const std::filesystem::path work_folder_;
  std::map<TileNumber, Tile> tiles_;
  size_t points_ = 0;
};

}  // namespace acmp
