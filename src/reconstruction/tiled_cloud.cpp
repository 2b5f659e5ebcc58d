#include "outputs.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<SurfacePoint>, "work files have points as they are in memory");

constexpr size_t kBlockPoints = size_t{1} << 16;  // of a work file, in memory at once

std::string TileName(const std::array<int64_t, 3>& number) { return Concat(number[0], "_", number[1], "_", number[2]); }

/// As they are in the tile's file.
nlohmann::json ToJson(const Eigen::Vector3d& origin, const Vec3f& v) {
  if (origin.isZero(0)) return {v.x, v.y, v.z};
  const Eigen::Vector3d place = InWorld(origin, v);
  return {place.x(), place.y(), place.z()};
}

}  // namespace

TiledCloud::TiledCloud(const OutputFolder* folder, double tile_size, size_t max_bytes, const Eigen::Vector3d& origin)
    : folder_(*folder),
      tile_size_(tile_size),
      max_points_(std::max(max_bytes / sizeof(SurfacePoint) / 2, kBlockPoints)),  // vectors grow by doubling
      origin_(origin),
      tiles_folder_(folder_.path() / "tiles") {}

TiledCloud::TileNumber TiledCloud::NumberOf(const Vec3f& position) const {
  const auto number = [this](double coordinate) {
    const double rounded = std::floor(coordinate / tile_size_);
    if (!(std::abs(rounded) <= static_cast<double>(kMaxTileNumber))) {
      throw InvalidInputError(Concat("--tile-size = ", tile_size_, ": a point at ", coordinate, " would be in tile ",
                                     rounded, ": must be within +-", kMaxTileNumber, ", so tiles must be larger"));
    }
    return static_cast<int64_t>(rounded);
  };
  const Eigen::Vector3d place = InWorld(origin_, position);
  return {number(place.x()), number(place.y()), number(place.z())};
}

TiledCloud::Tile* TiledCloud::TileOf(const Vec3f& position) {
  const TileNumber number = NumberOf(position);
  if (last_tile_ == nullptr || number != last_tile_->first) {
    const auto [found, is_new] = tiles_.try_emplace(number);
    if (is_new) found->second.min = found->second.max = position;
    if (tiles_.size() > kMaxTiles) {
      throw InvalidInputError(
          Concat("--tile-size = ", tile_size_, ": makes more than ", kMaxTiles, " tiles: they must be larger"));
    }
    last_tile_ = &*found;
  }
  return &last_tile_->second;
}

void TiledCloud::Add(const PointCloud& points) {
  for (const SurfacePoint& point : points) {
    if (in_memory_ == max_points_) MoveToFiles();
    const Vec3f& position = point.position;
    Tile* tile = TileOf(position);
    tile->min = {std::min(tile->min.x, position.x), std::min(tile->min.y, position.y),
                 std::min(tile->min.z, position.z)};
    tile->max = {std::max(tile->max.x, position.x), std::max(tile->max.y, position.y),
                 std::max(tile->max.z, position.z)};
    tile->in_memory.push_back(point);
    ++in_memory_;
    ++tile->points;
    ++points_;
  }
}

std::filesystem::path TiledCloud::WorkFileOf(const TileNumber& number) const {
  return work_folder_ / (TileName(number) + ".bin");
}

void TiledCloud::MoveToFiles() {
  if (work_folder_.empty()) work_folder_ = folder_.MakeWorkFolder("tiles");
  for (auto& [number, tile] : tiles_) {
    if (tile.in_memory.empty()) continue;
    std::ofstream file(WorkFileOf(number), std::ios::binary | std::ios::app);
    file.write(reinterpret_cast<const char*>(tile.in_memory.data()),
               static_cast<std::streamsize>(tile.in_memory.size() * sizeof(SurfacePoint)));
    if (!file.flush()) throw ProcessingError(Concat("cannot write ", WorkFileOf(number).string()));
    tile.in_memory = PointCloud();
  }
  in_memory_ = 0;
}

void TiledCloud::WriteTile(const TileNumber& number, const Tile& tile) const {
  PlyFile file(tiles_folder_ / (TileName(number) + ".ply"), Durability::kProcess, origin_);
  std::ifstream reader;
  size_t in_file = tile.points - tile.in_memory.size();
  if (in_file > 0) reader.open(WorkFileOf(number), std::ios::binary);
  for (PointCloud block; in_file > 0; in_file -= block.size()) {
    block.resize(std::min(kBlockPoints, in_file));
    if (!reader.read(reinterpret_cast<char*>(block.data()),
                     static_cast<std::streamsize>(block.size() * sizeof(SurfacePoint)))) {
      throw ProcessingError(Concat("cannot read the points in ", WorkFileOf(number).string()));
    }
    file.Append(block);
  }
  file.Append(tile.in_memory);
  file.Commit();
}

void TiledCloud::Commit(const StopRequest& interrupt) {
  MakeFolder(tiles_folder_);
  for (const auto& [number, tile] : tiles_) {
    interrupt.Check();
    WriteTile(number, tile);
  }
  WriteIndex();
}

void TiledCloud::WriteIndex() const {
  AtomicFile file(tiles_folder_ / "index.json", Durability::kPowerCut);
  file.Write(
      Concat("{\"tile_size\": ", nlohmann::json(tile_size_).dump(), ", \"points\": ", points_, ", \"tiles\": ["));
  const char* separator = "\n";
  for (const auto& [number, tile] : tiles_) {
    const nlohmann::ordered_json line = {{"file", TileName(number) + ".ply"},
                                         {"points", tile.points},
                                         {"min", ToJson(origin_, tile.min)},
                                         {"max", ToJson(origin_, tile.max)}};
    file.Write(separator + line.dump());
    separator = ",\n";
  }
  file.Write("\n]}\n");
  file.Commit();
}

}  // namespace acmp
