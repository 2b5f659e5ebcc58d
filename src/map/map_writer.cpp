#include "acmp_mapping/map/map_writer.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/folder_record.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/label_votes.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void RefusePath(const fs::path& path, const std::string& reason) {
  throw InvalidInputError(Concat("path = \"", path.string(), "\": ", reason));
}

std::string NoFolder(const fs::path& folder) { return Concat("there is no folder \"", folder.string(), "\""); }

/// home: where a file may lie, for the example in place of ~
void CheckName(const fs::path& path, const fs::path& home) {
  if (path.empty() || !path.has_filename()) RefusePath(path, "names no file");
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 127; };
  if (std::any_of(path.native().begin(), path.native().end(), is_control)) {  // which a log must not repeat
    throw InvalidInputError("path: must not contain control characters");
  }
  const fs::path first = *path.begin();
  if (path == "~" || (first.native()[0] == '~' && path.has_parent_path())) {
    const fs::path rest = path == first ? fs::path("map.ply") : path.lexically_relative(first);
    RefusePath(path, Concat("~ stands for no folder here: write it out, for example ", (home / rest).string()));
  }
}

bool IsWide(const MapCloud& map) { return !map.origin.isZero(0); }

/// @param labels HasLabels of the map
/// @param rgb type of the colours
std::string PcdHeader(const MapCloud& map, bool labels, const char* rgb, const char* data) {
  std::string fields;
  for (const char* field : kPackedFields) fields += Concat(" ", field);
  const auto with_label = [&](const char* value) { return labels ? Concat(" ", value) : ""; };
  return Concat("# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS", fields, with_label(kPackedLabel),
                "\nSIZE ", IsWide(map) ? "8 8 8" : "4 4 4", " 4 4 4 4 4", with_label("4"), "\nTYPE F F F ", rgb,
                " F F F F", with_label("U"), "\nCOUNT 1 1 1 1 1 1 1 1", with_label("1"), "\nWIDTH ", map.points.size(),
                "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS ", map.points.size(), "\nDATA ", data, "\n");
}

/// Colours are whole numbers here, as PCL writes them.
void WriteAsciiPcd(const fs::path& path, const MapCloud& map) {
  AtomicFile file(path, Durability::kPowerCut);
  const bool labels = HasLabels(map.points);
  file.Write(PcdHeader(map, labels, "U", "ascii"));
  const int digits = TextDigits(map.origin);
  for (const SurfacePoint& p : map.points) {
    const unsigned rgb = (unsigned{p.color.r} << 16) | (unsigned{p.color.g} << 8) | p.color.b;
    const Eigen::Vector3d position = InWorld(map.origin, p.position);
    file.Print("%.*g %.*g %.*g %u %.9g %.9g %.9g %.9g", digits, position.x(), digits, position.y(), digits,
               position.z(), rgb, p.normal.x, p.normal.y, p.normal.z, p.confidence);
    labels ? file.Print(" %d\n", p.label) : file.Write("\n");
  }
  file.Commit();
}

/// Point by point: PCL's writer would need the whole map twice more in memory, and takes 4 GB at most.
void WriteBinaryPcd(const fs::path& path, const MapCloud& map) {
  AtomicFile file(path, Durability::kPowerCut);
  const bool labels = HasLabels(map.points);
  file.Write(PcdHeader(map, labels, "F", "binary"));
  constexpr size_t kFloatPosition = 3 * sizeof(float);
  uint8_t packed[PackedPointBytes(true)];
  for (const SurfacePoint& p : map.points) {
    PackPoints(&p, 1, labels, packed);
    const Eigen::Vector3d position = InWorld(map.origin, p.position);
    IsWide(map) ? file.Write(position.data(), 3 * sizeof(double)) : file.Write(packed, kFloatPosition);
    file.Write(packed + kFloatPosition, PackedPointBytes(labels) - kFloatPosition);
  }
  file.Commit();
}

}  // namespace

fs::path MapPathBelow(const fs::path& folder, const fs::path& path, const std::string& ending) {
  std::error_code error;
  const fs::path top = fs::canonical(folder, error);
  if (error) throw InvalidInputError(Concat("save_folder = \"", folder.string(), "\": ", error.message()));
  CheckName(path, top);
  const fs::path whole = fs::weakly_canonical((top / path).parent_path(), error) / path.filename();
  const auto [end_of_top, below] = std::mismatch(top.begin(), top.end(), whole.begin(), whole.end());
  if (error || end_of_top != top.end()) {
    RefusePath(path, Concat("must lie below ", top.string(), ", the parameter save_folder of the map server"));
  }
  if (std::any_of(below, whole.end(), [](const fs::path& name) { return name.native()[0] == '.'; })) {
    RefusePath(path, "no name may begin with a dot");
  }
  if (path.extension() != ending) RefusePath(path, Concat("must end in ", ending));
  if (!fs::is_directory(whole.parent_path(), error)) RefusePath(path, NoFolder(whole.parent_path()));
  return whole;
}

void ClaimMapFile(const fs::path& path) {
  FolderRecord(path.parent_path(), kSavedFiles).Claim({path.filename().string()});
}

void CheckMapPath(const fs::path& path) {
  const char* home = std::getenv("HOME");
  CheckName(path, home ? home : "/home/you");
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!fs::is_directory(folder)) RefusePath(path, NoFolder(fs::absolute(folder)));
  if (fs::is_directory(path)) RefusePath(path, "is a folder");
}

void WriteMap(const fs::path& path, const MapCloud& map, MapFormat format, bool binary) {
  if (map.points.empty()) throw InvalidInputError("the map is empty: nothing was written");
  CheckMapPath(path);
  if (format == MapFormat::kPly) return WritePly(path, map.points, map.origin, binary);
  return binary ? WriteBinaryPcd(path, map) : WriteAsciiPcd(path, map);
}

void WriteMap(const fs::path& path, const MapMesh& map, MeshFormat format) {
  CheckMapPath(path);
  WriteMesh(path, map.mesh, format, map.origin);
}

namespace {

struct Packed {
  float x, y, z;
  uint8_t b, g, r, zero;
  float normal_x, normal_y, normal_z, confidence;
  uint32_t label;
};
static_assert(sizeof(Packed) == PackedPointBytes(true), "eight float32 fields and a uint32");

}  // namespace

void PackPoints(const SurfacePoint* points, size_t count, bool labels, uint8_t* target) {
  const size_t bytes = PackedPointBytes(labels);
  for (size_t i = 0; i < count; ++i) {
    const SurfacePoint& p = points[i];
    const Packed packed = {p.position.x, p.position.y, p.position.z, p.color.b,    p.color.g, p.color.r, 0,
                           p.normal.x,   p.normal.y,   p.normal.z,   p.confidence, p.label};
    std::memcpy(target + i * bytes, &packed, bytes);
  }
}

PointCloud UnpackPoints(const uint8_t* source, size_t count, bool labels) {
  const size_t bytes = PackedPointBytes(labels);
  PointCloud points;
  points.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    Packed p = {};
    std::memcpy(&p, source + i * bytes, bytes);
    if (p.label > kMaxLabel) {
      throw InvalidInputError(Concat("label of point ", i, " = ", p.label, ": must be at most ", kMaxLabel));
    }
    points.push_back({{p.x, p.y, p.z},
                      {p.normal_x, p.normal_y, p.normal_z},
                      {p.r, p.g, p.b},
                      static_cast<Label>(p.label),
                      p.confidence});
  }
  return points;
}

}  // namespace acmp
