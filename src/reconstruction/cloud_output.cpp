#include "cloud_output.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "work_files.h"

namespace acmp {
namespace {

constexpr size_t kBlockPoints = size_t{1} << 16;  // at most: they are in memory at once when they are read
constexpr size_t kWriteBytes = size_t{1} << 20;   // to the work file at once

/// Of a block in the work file; the points follow.
struct TileBlock {
  uint64_t previous = 0;  ///< place of the tile's block before it
  uint64_t points = 0;
};

std::string FileNameOf(const std::array<int64_t, 3>& number) {
  return Concat(number[0], "_", number[1], "_", number[2], ".ply");
}

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
      max_points_(std::max<size_t>(max_bytes / sizeof(SurfacePoint) / 2, 1)),  // vectors grow by doubling
      origin_(origin) {}

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
  if (last_tile_ == nullptr || number != last_number_) {
    const auto [found, is_new] = tiles_.try_emplace(number);
    if (is_new) found->second.min = found->second.max = position;
    if (tiles_.size() > kMaxTiles) {
      throw InvalidInputError(
          Concat("--tile-size = ", tile_size_, ": makes more than ", kMaxTiles, " tiles: they must be larger"));
    }
    last_number_ = number;
    last_tile_ = &found->second;
  }
  return last_tile_;
}

void TiledCloud::Add(const PointCloud& points) {
  for (const SurfacePoint& point : points) {
    if (in_memory_ == max_points_) MoveToFile();
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

void TiledCloud::MoveToFile() {
  if (!file_) {
    const std::filesystem::path path = folder_.WorkFile(kFolder, 0);
    MakeFolder(path.parent_path());
    file_.emplace(path);
    reader_.open(file_->temporary_path(), std::ios::binary);
  }
  std::string bytes;
  const auto write = [&] {
    file_->WriteAt(file_bytes_, bytes.data(), bytes.size());
    file_bytes_ += bytes.size();
    bytes.clear();
  };
  for (auto& [number, tile] : tiles_) {
    for (size_t first = 0; first < tile.in_memory.size(); first += kBlockPoints) {
      const TileBlock header = {tile.last_block, std::min(kBlockPoints, tile.in_memory.size() - first)};
      tile.last_block = file_bytes_ + bytes.size();
      bytes.append(reinterpret_cast<const char*>(&header), sizeof(header));
      bytes.append(reinterpret_cast<const char*>(&tile.in_memory[first]), header.points * sizeof(SurfacePoint));
      if (bytes.size() >= kWriteBytes) write();
    }
    tile.in_memory = PointCloud();
  }
  write();
  in_memory_ = 0;
}

PointCloud TiledCloud::ReadBlock(uint64_t* place) {
  TileBlock header;
  reader_.seekg(static_cast<std::streamoff>(*place));
  reader_.read(reinterpret_cast<char*>(&header), sizeof(header));
  PointCloud points(reader_ ? std::min<uint64_t>(header.points, kBlockPoints) : 0);
  reader_.read(reinterpret_cast<char*>(points.data()),
               static_cast<std::streamsize>(points.size() * sizeof(SurfacePoint)));
  if (!reader_) throw ProcessingError(Concat("cannot read the points in ", file_->temporary_path().string()));
  *place = header.previous;
  return points;
}

void TiledCloud::WriteTile(const std::filesystem::path& path, const Tile& tile) {
  PlyFile file(path, Durability::kProcess, origin_);
  size_t end = file.Reserve(tile.points) + tile.points - tile.in_memory.size();  // of what is in the work file
  file.WriteAt(end, tile.in_memory);
  for (uint64_t block = tile.last_block; block != kNoBlock;) {
    const PointCloud points = ReadBlock(&block);
    end -= points.size();
    file.WriteAt(end, points);
  }
  file.Commit();
}

void TiledCloud::Commit(const StopRequest& interrupt) {
  MakeFolder(FolderOfTiles());
  for (const auto& [number, tile] : tiles_) {
    interrupt.Check();
    WriteTile(FolderOfTiles() / FileNameOf(number), tile);
  }
  WriteIndex();
}

void TiledCloud::WriteIndex() const {
  AtomicFile file(FolderOfTiles() / kIndexName, Durability::kPowerCut);
  file.Write(
      Concat("{\"tile_size\": ", nlohmann::json(tile_size_).dump(), ", \"points\": ", points_, ", \"tiles\": ["));
  const char* separator = "\n";
  for (const auto& [number, tile] : tiles_) {
    const nlohmann::ordered_json line = {{"file", FileNameOf(number)},
                                         {"points", tile.points},
                                         {"min", ToJson(origin_, tile.min)},
                                         {"max", ToJson(origin_, tile.max)}};
    file.Write(separator + line.dump());
    separator = ",\n";
  }
  file.Write("\n]}\n");
  file.Commit();
}

CloudOutput::CloudOutput(const ReconstructRun& run) : interrupt_(run.interrupt) {
  if (run.options.tile_size) {
    tiles_ =
        std::make_unique<TiledCloud>(run.folder, *run.options.tile_size, run.options.CloudBytes(), run.plan.origin);
  } else {
    file_ = std::make_unique<PlyFile>(run.folder->path() / "fused.ply", Durability::kPowerCut, run.plan.origin);
  }
}

void CloudOutput::WriteAt(size_t first, const PointCloud& points) {
  if (file_) return file_->WriteAt(first, points);
  tiles_->Add(points);
}

void CloudOutput::Commit() {
  if (file_) return file_->Commit();
  tiles_->Commit(interrupt_);
}

CloudSize CloudOutput::size() const {
  if (file_) return {file_->points(), std::nullopt};
  return {tiles_->points(), tiles_->tiles()};
}

void WaitingClouds::Put(int index, PointCloud cloud) {
  const size_t points = cloud.size(), bytes = points * sizeof(SurfacePoint);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (bytes_ + bytes <= max_bytes_) {
      bytes_ += bytes;
      waiting_[index] = {points, std::move(cloud)};
      return;
    }
  }
  WritePoints(FileOf(index), cloud);
  const std::lock_guard<std::mutex> lock(mutex_);
  waiting_[index] = {points, {}};
}

size_t WaitingClouds::NumPoints(int index) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return waiting_.at(index).points;
}

PointCloud WaitingClouds::Take(int index) {
  Waiting taken;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    taken = std::move(waiting_.at(index));
    waiting_.erase(index);
    bytes_ -= taken.cloud.size() * sizeof(SurfacePoint);
  }
  if (taken.cloud.size() == taken.points) return std::move(taken.cloud);
  std::optional<PointCloud> cloud = ReadPoints(FileOf(index));
  if (!cloud) throw ProcessingError(Concat("cannot read the ", taken.points, " points of ", FileOf(index).string()));
  std::error_code ignored;  // what is left goes with the work folder
  std::filesystem::remove(FileOf(index), ignored);
  return std::move(*cloud);
}

}  // namespace acmp
