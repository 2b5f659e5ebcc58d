#include "acmp_mapping/evaluation/cloud_metrics.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"

namespace acmp {
namespace {

constexpr const char* kIndexName = "index.json";

nlohmann::json ReadIndex(const std::filesystem::path& path) {
  std::ifstream stream(path);
  if (!stream) throw InvalidInputError(Concat(path.string(), ": cannot be read"));
  nlohmann::json index = nlohmann::json::parse(stream, nullptr, false);
  if (!index.is_object() || !index.contains("tiles") || !index["tiles"].is_array()) {
    throw InvalidInputError(Concat(path.string(), ": must be JSON with a list \"tiles\""));
  }
  return index;
}

void AppendTile(const std::filesystem::path& index, const nlohmann::json& tile, PointCloud* points,
                ReadOrigin* origin) {
  const auto has = [&tile](const char* key) { return tile.is_object() && tile.contains(key); };
  if (!has("file") || !tile["file"].is_string() || !has("points") || !tile["points"].is_number_unsigned()) {
    throw InvalidInputError(Concat(index.string(),
                                   ": a tile must have \"file\", a name, and \"points\", a number, and is ",
                                   tile.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).substr(0, 100)));
  }
  const std::filesystem::path name = tile["file"].get<std::string>();
  if (name != name.filename()) {
    throw InvalidInputError(Concat(index.string(), ": file ", name, ": must be in the same folder"));
  }
  const std::filesystem::path path = index.parent_path() / name;
  const PointCloud read = ReadPly(path, origin);
  const auto listed = tile["points"].get<uint64_t>();
  if (read.size() != listed) {
    throw InvalidInputError(
        Concat(path.string(), ": has ", read.size(), " points: must be ", listed, ", as ", kIndexName, " says"));
  }
  points->insert(points->end(), read.begin(), read.end());
}

}  // namespace

bool IsTiledCloud(const std::filesystem::path& path) {
  return path.filename() == kIndexName || std::filesystem::exists(path / kIndexName);
}

PointCloud ReadTiledCloud(const std::filesystem::path& path, ReadOrigin* origin) {
  const std::filesystem::path index_path = path.filename() == kIndexName ? path : path / kIndexName;
  const nlohmann::json index = ReadIndex(index_path);
  PointCloud points;
  for (const nlohmann::json& tile : index["tiles"]) AppendTile(index_path, tile, &points, origin);
  return points;
}

}  // namespace acmp
