#include "acmp_mapping/map/map_writer.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <system_error>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/map/packed_points.h"

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
  if (path.native().find('\0') != std::string::npos) {  // what() would end there
    throw InvalidInputError("path: must not contain a zero character");
  }
  const fs::path first = *path.begin();
  if (path == "~" || (first.native()[0] == '~' && path.has_parent_path())) {
    const fs::path rest = path == first ? fs::path("map.ply") : path.lexically_relative(first);
    RefusePath(path, Concat("~ stands for no folder here: write it out, for example ", (home / rest).string()));
  }
}

constexpr size_t kLineBytes = 200;  ///< of a point in a text file; numbers have 9 digits, so that a float32 reads back

std::string PcdHeader(size_t points, const char* types, const char* data) {
  std::string fields;
  for (const char* field : kPackedFields) fields += Concat(" ", field);
  return Concat("# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS", fields,
                "\nSIZE 4 4 4 4 4 4 4 4\nTYPE ", types, "\nCOUNT 1 1 1 1 1 1 1 1\nWIDTH ", points,
                "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS ", points, "\nDATA ", data, "\n");
}

/// Colours are whole numbers here, as PCL writes them.
void WriteAsciiPcd(const fs::path& path, const PointCloud& map) {
  AtomicFile file(path, Durability::kPowerCut);
  file.Write(PcdHeader(map.size(), "F F F U F F F F", "ascii"));
  for (const SurfacePoint& p : map) {
    const unsigned rgb = (unsigned{p.color.r} << 16) | (unsigned{p.color.g} << 8) | p.color.b;
    char line[kLineBytes];
    const int length = std::snprintf(line, sizeof(line), "%.9g %.9g %.9g %u %.9g %.9g %.9g %.9g\n", p.position.x,
                                     p.position.y, p.position.z, rgb, p.normal.x, p.normal.y, p.normal.z, p.confidence);
    file.Write(line, static_cast<size_t>(length));
  }
  file.Commit();
}

/// Piece by piece: PCL's writer would need the whole map twice more in memory, and takes 4 GB at most.
void WriteBinaryPcd(const fs::path& path, const PointCloud& map) {
  AtomicFile file(path, Durability::kPowerCut);
  file.Write(PcdHeader(map.size(), "F F F F F F F F", "binary"));
  constexpr size_t kPiece = 4096;
  std::vector<uint8_t> bytes(kPiece * kPackedPointBytes);
  for (size_t i = 0; i < map.size(); i += kPiece) {
    const size_t count = std::min(kPiece, map.size() - i);
    PackPoints(map.data() + i, count, bytes.data());
    file.Write(bytes.data(), count * kPackedPointBytes);
  }
  file.Commit();
}

/// The properties of WritePly.
void WriteAsciiPly(const fs::path& path, const PointCloud& map) {
  AtomicFile file(path, Durability::kPowerCut);
  file.Write(Concat("ply\nformat ascii 1.0\nelement vertex ", map.size(),
                    "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n"
                    "property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
                    "property float confidence\nend_header\n"));
  for (const SurfacePoint& p : map) {
    char line[kLineBytes];
    const int length =
        std::snprintf(line, sizeof(line), "%.9g %.9g %.9g %.9g %.9g %.9g %d %d %d %.9g\n", p.position.x, p.position.y,
                      p.position.z, p.normal.x, p.normal.y, p.normal.z, p.color.r, p.color.g, p.color.b, p.confidence);
    file.Write(line, static_cast<size_t>(length));
  }
  file.Commit();
}

}  // namespace

fs::path MapPathBelow(const fs::path& folder, const fs::path& path) {
  std::error_code error;
  const fs::path top = fs::canonical(folder, error);
  if (error) throw InvalidInputError(Concat("save_folder = \"", folder.string(), "\": ", error.message()));
  CheckName(path, top);
  const fs::path parent = fs::canonical((top / path).parent_path(), error);
  if (error) RefusePath(path, NoFolder((top / path).parent_path()));
  if (std::mismatch(top.begin(), top.end(), parent.begin(), parent.end()).first != top.end()) {
    RefusePath(path, Concat("must lie below ", top.string(), ", the parameter save_folder of the map server"));
  }
  return parent / path.filename();
}

void CheckEnding(const fs::path& path, const std::string& ending, const std::string& format, const std::string& other) {
  if (!path.has_extension() || LowerExtension(path) == ending) return;
  RefusePath(path, Concat("must end in ", ending, " for ", format, other));
}

void CheckMapPath(const fs::path& path) {
  const char* home = std::getenv("HOME");
  CheckName(path, home ? home : "/home/you");
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!fs::is_directory(folder)) RefusePath(path, NoFolder(fs::absolute(folder)));
  if (fs::is_directory(path)) RefusePath(path, "is a folder");
}

void WriteMap(const fs::path& path, const PointCloud& map, MapFormat format, bool binary) {
  if (map.empty()) throw InvalidInputError("the map is empty: nothing was written");
  CheckMapPath(path);
  if (format == MapFormat::kPly) return binary ? WritePly(path, map) : WriteAsciiPly(path, map);
  return binary ? WriteBinaryPcd(path, map) : WriteAsciiPcd(path, map);
}

void WriteMap(const fs::path& path, const TriangleMesh& map, MeshFormat format) {
  CheckMapPath(path);
  WriteMesh(path, map, format);
}

}  // namespace acmp
