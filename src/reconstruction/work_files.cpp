#include "work_files.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <type_traits>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<SurfacePoint>, "files have points as they are in memory");

constexpr size_t kReadAtOnce = size_t{1} << 18;

struct WorkHeader {
  uint32_t magic = 0x354b5257;  // "WRK5"
  uint32_t checksum = 0;        ///< of the content
  uint64_t bytes = 0;           ///< of the content
};

uint32_t AddToChecksum(uint32_t checksum, const void* data, size_t bytes) {
  if (bytes == 0) return checksum;  // zlib would begin anew
  return static_cast<uint32_t>(crc32_z(checksum, static_cast<const Bytef*>(data), bytes));
}

/// Some bytes in memory.
using Piece = std::pair<const void*, size_t>;

void WritePieces(const std::filesystem::path& path, const std::vector<Piece>& pieces) {
  WorkHeader header;
  for (const auto& [data, bytes] : pieces) {
    header.checksum = AddToChecksum(header.checksum, data, bytes);
    header.bytes += bytes;
  }
  MakeFolder(path.parent_path());
  AtomicFile file(path);
  file.Write(&header, sizeof(header));
  for (const auto& [data, bytes] : pieces) file.Write(data, bytes);
  file.Commit();
}

/// Reads a work file piece by piece. What it gives is right once IsWhole says so.
class WorkFileReader {
 public:
  explicit WorkFileReader(const std::filesystem::path& path) : stream_(path, std::ios::binary) {
    std::error_code error;
    const auto bytes = std::filesystem::file_size(path, error);
    WorkHeader header;
    stream_.read(reinterpret_cast<char*>(&header), sizeof(header));
    ok_ = !error && stream_ && header.magic == WorkHeader().magic && header.bytes == bytes - sizeof(header);
    left_ = ok_ ? header.bytes : 0;
    expected_ = header.checksum;
  }

  size_t left() const { return left_; }  ///< bytes; 0 in a file that is damaged
  void Read(void* data, size_t bytes) {
    ok_ = ok_ && bytes <= left_ && stream_.read(static_cast<char*>(data), static_cast<std::streamsize>(bytes));
    if (!ok_) return;
    checksum_ = AddToChecksum(checksum_, data, bytes);
    left_ -= bytes;
  }
  bool IsWhole() const { return ok_ && left_ == 0 && checksum_ == expected_; }

 private:
  std::ifstream stream_;
  bool ok_ = false;
  size_t left_ = 0;
  uint32_t checksum_ = 0, expected_ = 0;
};

/// A file's content as a string or vector of what can be copied bit by bit.
template <class Elements>
std::optional<Elements> ReadContent(const std::filesystem::path& path) {
  constexpr size_t kElement = sizeof(typename Elements::value_type);
  WorkFileReader reader(path);
  Elements elements(reader.left() / kElement, typename Elements::value_type());
  reader.Read(static_cast<void*>(elements.data()), elements.size() * kElement);
  if (!reader.IsWhole()) return std::nullopt;
  return elements;
}

/// Of a file of maps; their pixels follow.
struct MapsHeader {
  int32_t width = 0;   ///< px
  int32_t height = 0;  ///< px
  int32_t has_confidence = 0;
};

template <class... Pixels>
void WriteMaps(const std::filesystem::path& path, const MapsHeader& header, const Image<Pixels>&... maps) {
  WritePieces(path, {{&header, sizeof(header)}, {maps.data(), maps.size() * sizeof(Pixels)}...});
}

/// Reads maps one after the other.
class MapReader {
 public:
  explicit MapReader(const std::filesystem::path& path) : path_(path), reader_(path) {
    reader_.Read(&header_, sizeof(header_));
  }

  const MapsHeader& header() const { return header_; }

  template <class T>
  void Read(Image<T>* map) {
    const int64_t pixels = int64_t{header_.width} * header_.height;
    if (header_.width < 0 || pixels < 0 || static_cast<uint64_t>(pixels) > reader_.left() / sizeof(T)) FailDamaged();
    *map = Image<T>(header_.width, header_.height);
    reader_.Read(map->data(), map->size() * sizeof(T));
  }

  /// After the last map: throws unless all of them are what was written.
  void Finish() const {
    if (!reader_.IsWhole()) FailDamaged();
  }
  [[noreturn]] void FailDamaged() const {
    throw ProcessingError(
        Concat("the work file ", path_.string(), " is damaged: the same command again makes it anew"));
  }

 private:
  const std::filesystem::path path_;
  MapsHeader header_;
  WorkFileReader reader_;
};

}  // namespace

WorkFileState CheckWorkFile(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) return WorkFileState::kMissing;
  WorkFileReader reader(path);
  std::vector<char> block(kReadAtOnce);
  for (size_t left = reader.left(); left > 0; left = left > block.size() ? left - block.size() : 0) {
    reader.Read(block.data(), std::min(left, block.size()));
  }
  return reader.IsWhole() ? WorkFileState::kWhole : WorkFileState::kDamaged;
}

void WriteWorkFile(const std::filesystem::path& path, const std::string& content) {
  WritePieces(path, {{content.data(), content.size()}});
}

std::optional<std::string> ReadWorkFile(const std::filesystem::path& path) { return ReadContent<std::string>(path); }

void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate) {
  WriteMaps(path, {estimate.planes.width(), estimate.planes.height(), 0}, estimate.planes, estimate.cost);
}

EstimateState ReadEstimate(const std::filesystem::path& path, int width, int height) {
  MapReader reader(path);
  if (reader.header().width != width || reader.header().height != height) reader.FailDamaged();
  EstimateState estimate;
  reader.Read(&estimate.planes);
  reader.Read(&estimate.cost);
  reader.Finish();
  return estimate;
}

void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps) {
  const MapsHeader header = {maps.depth.width(), maps.depth.height(), maps.confidence.empty() ? 0 : 1};
  WriteMaps(path, header, maps.depth, maps.normal, maps.cost, maps.confidence);
}

FinalMaps ReadFinalMaps(const std::filesystem::path& path) {
  MapReader reader(path);
  FinalMaps maps;
  reader.Read(&maps.depth);
  reader.Read(&maps.normal);
  reader.Read(&maps.cost);
  if (reader.header().has_confidence) reader.Read(&maps.confidence);
  reader.Finish();
  return maps;
}

void WritePoints(const std::filesystem::path& path, const PointCloud& cloud) {
  WritePieces(path, {{cloud.data(), cloud.size() * sizeof(SurfacePoint)}});
}

std::optional<PointCloud> ReadPoints(const std::filesystem::path& path) { return ReadContent<PointCloud>(path); }

std::optional<uint32_t> ChecksumOfFile(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::vector<char> block(kReadAtOnce);
  uint32_t checksum = 0;
  while (file.read(block.data(), static_cast<std::streamsize>(block.size())) || file.gcount() > 0) {
    checksum = AddToChecksum(checksum, block.data(), static_cast<size_t>(file.gcount()));
  }
  return checksum;
}

}  // namespace acmp
