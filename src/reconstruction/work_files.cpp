#include "work_files.h"

#include <zlib.h>

#include <algorithm>
#include <cstddef>
#include <fstream>
#include <memory>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

enum class Content : uint32_t { kEstimate = 0x34545345, kFinalMaps = 0x3350414d };  // "EST4", "MAP3"

struct Header {
  Content content{};
  int32_t width = 0;   ///< px
  int32_t height = 0;  ///< px
  int32_t has_confidence = 0;
  uint32_t checksum = 0;  ///< of what is before and of all that follows
};

/// CRC-32 of a file's header but for the checksum in it, and then of what is added.
class Checksum {
 public:
  explicit Checksum(const Header& header) { Add(&header, offsetof(Header, checksum)); }
  void Add(const void* data, size_t bytes) {
    if (bytes > 0) value_ = crc32_z(value_, static_cast<const Bytef*>(data), bytes);  // of no data it would be 0
  }
  uint32_t value() const { return static_cast<uint32_t>(value_); }

 private:
  uLong value_ = 0;
};

size_t BytesOf(const Header& header) {
  const size_t floats = header.content == Content::kEstimate ? 5 : 5 + (header.has_confidence ? 1 : 0);
  const size_t per_pixel = floats * sizeof(float) + (header.content == Content::kEstimate ? 0 : sizeof(Rgb));
  return sizeof(Header) + static_cast<size_t>(header.width) * header.height * per_pixel;
}
static_assert(sizeof(PlaneHypothesis) + sizeof(float) == 5 * sizeof(float));

bool IsValid(const Header& header, size_t bytes) {
  return (header.content == Content::kEstimate || header.content == Content::kFinalMaps) && header.width > 0 &&
         header.height > 0 && BytesOf(header) == bytes;
}

template <class... Pixels>
void WriteMaps(const std::filesystem::path& path, Header header, const Image<Pixels>&... maps) {
  Checksum checksum(header);
  (checksum.Add(maps.data(), maps.size() * sizeof(Pixels)), ...);
  header.checksum = checksum.value();
  MakeFolder(path.parent_path());
  AtomicFile file(path);
  file.Write(&header, sizeof(header));
  (file.Write(maps.data(), maps.size() * sizeof(Pixels)), ...);
  file.Commit();
}

[[noreturn]] void FailDamaged(const std::filesystem::path& path) {
  throw ProcessingError(Concat("the work file ", path.string(), " is damaged: the same command again makes it anew"));
}

/// A work file whose length is right for its header; null when it is not.
std::unique_ptr<std::ifstream> Open(const std::filesystem::path& path, Header* header) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(path, error);
  auto file = std::make_unique<std::ifstream>(path, std::ios::binary);
  file->read(reinterpret_cast<char*>(header), sizeof(*header));
  return !error && *file && IsValid(*header, bytes) ? std::move(file) : nullptr;
}

/// Reads maps one after the other.
class MapReader {
 public:
  MapReader(const std::filesystem::path& path, Content content)
      : path_(path), stream_(Open(path, &header_)), checksum_(header_) {
    if (!stream_ || header_.content != content) FailDamaged(path);
  }

  const Header& header() const { return header_; }

  template <class T>
  void Read(Image<T>* map) {
    *map = Image<T>(header_.width, header_.height);
    stream_->read(reinterpret_cast<char*>(map->data()), static_cast<std::streamsize>(map->size() * sizeof(T)));
    if (!*stream_) FailDamaged(path_);
    checksum_.Add(map->data(), map->size() * sizeof(T));
  }

  /// After the last map: throws unless all of them are what was written.
  void Finish() const {
    if (checksum_.value() != header_.checksum) FailDamaged(path_);
  }

 private:
  std::filesystem::path path_;
  Header header_;
  std::unique_ptr<std::ifstream> stream_;
  Checksum checksum_;
};

}  // namespace

WorkFileState CheckWorkFile(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) return WorkFileState::kMissing;
  Header header;
  const std::unique_ptr<std::ifstream> file = Open(path, &header);
  if (!file) return WorkFileState::kDamaged;
  Checksum checksum(header);
  std::vector<char> block(size_t{1} << 18);
  for (size_t left = BytesOf(header) - sizeof(header); left > 0;) {
    const size_t bytes = std::min(left, block.size());
    if (!file->read(block.data(), static_cast<std::streamsize>(bytes))) return WorkFileState::kDamaged;
    checksum.Add(block.data(), bytes);
    left -= bytes;
  }
  return checksum.value() == header.checksum ? WorkFileState::kWhole : WorkFileState::kDamaged;
}

void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate) {
  const Header header = {Content::kEstimate, estimate.planes.width(), estimate.planes.height(), 0, 0};
  WriteMaps(path, header, estimate.planes, estimate.cost);
}

EstimateState ReadEstimate(const std::filesystem::path& path, int width, int height) {
  MapReader reader(path, Content::kEstimate);
  if (reader.header().width != width || reader.header().height != height) FailDamaged(path);
  EstimateState estimate;
  reader.Read(&estimate.planes);
  reader.Read(&estimate.cost);
  reader.Finish();
  return estimate;
}

void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps) {
  const Header header = {Content::kFinalMaps, maps.depth.width(), maps.depth.height(), maps.confidence.empty() ? 0 : 1,
                         0};
  WriteMaps(path, header, maps.depth, maps.normal, maps.cost, maps.color, maps.confidence);
}

FinalMaps ReadFinalMaps(const std::filesystem::path& path) {
  MapReader reader(path, Content::kFinalMaps);
  FinalMaps maps;
  reader.Read(&maps.depth);
  reader.Read(&maps.normal);
  reader.Read(&maps.cost);
  reader.Read(&maps.color);
  if (reader.header().has_confidence) reader.Read(&maps.confidence);
  reader.Finish();
  return maps;
}

}  // namespace acmp
