#include "outputs.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
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
nlohmann::json ToJson(const Eigen::Vector3d& origin, const Eigen::Vector3f& v) {
  if (origin.isZero(0)) return {v.x(), v.y(), v.z()};
  const Eigen::Vector3d place = InWorld(origin, {v.x(), v.y(), v.z()});
  return {place.x(), place.y(), place.z()};
}

}  // namespace

TiledCloud::TiledCloud(const OutputFolder* folder, double tile_size, const Eigen::Vector3d& origin)
    : folder_(*folder),
      tile_size_(tile_size),
      origin_(origin),
      tiles_folder_(folder_.path() / "tiles"),
      work_folder_(folder_.MakeWorkFolder("tiles")) {}

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

void TiledCloud::Add(const PointCloud& points) {
  std::map<TileNumber, PointCloud> parts;
  for (const SurfacePoint& point : points) parts[NumberOf(point.position)].push_back(point);
  for (const auto& [number, part] : parts) {
    Tile& tile = tiles_[number];
    if (tiles_.size() > kMaxTiles) {
      throw InvalidInputError(
          Concat("--tile-size = ", tile_size_, ": makes more than ", kMaxTiles, " tiles: they must be larger"));
    }
    for (const SurfacePoint& point : part) {
      tile.box.extend(Eigen::Vector3f(point.position.x, point.position.y, point.position.z));
    }
    std::ofstream file(WorkFileOf(number), std::ios::binary | std::ios::app);
    file.write(reinterpret_cast<const char*>(part.data()),
               static_cast<std::streamsize>(part.size() * sizeof(SurfacePoint)));
    if (!file.flush()) throw ProcessingError(Concat("cannot write ", WorkFileOf(number).string()));
    tile.points += part.size();
    points_ += part.size();
  }
}

std::filesystem::path TiledCloud::WorkFileOf(const TileNumber& number) const {
  return work_folder_ / (TileName(number) + ".bin");
}

void TiledCloud::WriteTile(const TileNumber& number, const Tile& tile) const {
  PlyFile file(tiles_folder_ / (TileName(number) + ".ply"), Durability::kProcess, origin_);
  std::ifstream reader(WorkFileOf(number), std::ios::binary);
  PointCloud block;
  for (size_t left = tile.points; left > 0; left -= block.size()) {
    block.resize(std::min(kBlockPoints, left));
    if (!reader.read(reinterpret_cast<char*>(block.data()),
                     static_cast<std::streamsize>(block.size() * sizeof(SurfacePoint)))) {
      throw ProcessingError(Concat("cannot read the points in ", WorkFileOf(number).string()));
    }
    file.Append(block);
  }
  file.Commit();
}

void TiledCloud::Commit(const StopRequest& interrupt) {
  std::set<std::string> names;
  for (const auto& [number, tile] : tiles_) names.insert(Concat("tiles/", TileName(number), ".ply"));
  folder_.Claim(names);
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
                                         {"min", ToJson(origin_, tile.box.min())},
                                         {"max", ToJson(origin_, tile.box.max())}};
    file.Write(separator + line.dump());
    separator = ",\n";
  }
  file.Write("\n]}\n");
  file.Commit();
}

}  // namespace acmp
