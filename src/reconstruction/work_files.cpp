#include "work_files.h"

#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <type_traits>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

constexpr size_t kReadAtOnce = size_t{1} << 18;

struct WorkHeader {
  uint32_t magic = 0x374b5257;  // "WRK7"
  uint32_t checksum = 0;        ///< of the content
  uint64_t bytes = 0;           ///< of the content
};

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

/// Of a file of maps; their pixels follow.
struct MapsHeader {
  int32_t width = 0;   ///< px
  int32_t height = 0;  ///< px
};

/// Empty ones are left out.
template <class First, class... Pixels>
void WriteMaps(const std::filesystem::path& path, const Image<First>& first, const Image<Pixels>&... maps) {
  const MapsHeader header = {first.width(), first.height()};
  WritePieces(path, {{&header, sizeof(header)},
                     {first.data(), first.size() * sizeof(First)},
                     {maps.data(), maps.size() * sizeof(Pixels)}...});
}

/// Those at the end that the file does not have stay empty.
template <class... Pixels>
void ReadMaps(const std::filesystem::path& path, Image<Pixels>*... maps) {
  WorkFileReader reader(path);
  MapsHeader header;
  reader.Read(&header, sizeof(header));
  const auto pixels = static_cast<uint64_t>(int64_t{header.width} * header.height);
  const auto read = [&](auto* map) {
    using Pixel = std::remove_pointer_t<decltype(map->data())>;
    if (header.width <= 0 || header.height <= 0 || reader.left() == 0 || pixels > reader.left() / sizeof(Pixel)) return;
    *map = Image<Pixel>(header.width, header.height);
    reader.Read(map->data(), map->size() * sizeof(Pixel));
  };
  (read(maps), ...);
  if (reader.IsWhole()) return;
  throw ProcessingError(Concat("the work file ", path.string(), " is damaged: the same command again makes it anew"));
}

/// Nothing where it cannot be read.
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

}  // namespace

uint32_t AddToChecksum(uint32_t checksum, const void* data, size_t bytes) {
  if (bytes == 0) return checksum;  // zlib would begin anew
  return static_cast<uint32_t>(crc32_z(checksum, static_cast<const Bytef*>(data), bytes));
}

std::string ChecksumsOf(const std::vector<std::filesystem::path>& paths) {
  std::string checksums;
  for (const std::filesystem::path& path : paths) {
    const std::optional<uint32_t> checksum = ChecksumOfFile(path);
    checksums += checksum ? Concat(*checksum, " ") : "none ";
  }
  return checksums;
}

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

std::optional<std::string> ReadWorkFile(const std::filesystem::path& path) {
  WorkFileReader reader(path);
  std::string content(reader.left(), '\0');
  reader.Read(content.data(), content.size());
  if (!reader.IsWhole()) return std::nullopt;
  return content;
}

void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate) {
  WriteMaps(path, estimate.planes, estimate.cost);
}

EstimateState ReadEstimate(const std::filesystem::path& path) {
  EstimateState estimate;
  ReadMaps(path, &estimate.planes, &estimate.cost);
  return estimate;
}

void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps) {
  WriteMaps(path, maps.depth, maps.normal, maps.cost, maps.confidence);
}

FinalMaps ReadFinalMaps(const std::filesystem::path& path) {
  FinalMaps maps;
  ReadMaps(path, &maps.depth, &maps.normal, &maps.cost, &maps.confidence);
  return maps;
}

}  // namespace acmp
