#include "work_files.h"

#include <fstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

enum class Content : uint32_t { kEstimate = 0x33545345, kFinalMaps = 0x3250414d };  // "EST3", "MAP2"

struct Header {
  Content content{};
  int32_t width = 0;   ///< px
  int32_t height = 0;  ///< px
  int32_t has_confidence = 0;
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
void WriteMaps(const std::filesystem::path& path, const Header& header, const Image<Pixels>&... maps) {
  MakeFolder(path.parent_path());
  AtomicFile file(path);
  file.Write(&header, sizeof(header));
  (file.Write(maps.data(), maps.size() * sizeof(Pixels)), ...);
  file.Commit();
}

[[noreturn]] void FailDamaged(const std::filesystem::path& path) {
  throw ProcessingError(Concat("the work file ", path.string(), " is damaged: give --overwrite to start afresh"));
}

/// Reads maps one after the other.
class MapReader {
 public:
  MapReader(const std::filesystem::path& path, Content content) : path_(path), stream_(path, std::ios::binary) {
    if (!IsWholeWorkFile(path)) FailDamaged(path);
    stream_.read(reinterpret_cast<char*>(&header_), sizeof(header_));
    if (header_.content != content) FailDamaged(path);
  }

  const Header& header() const { return header_; }

  template <class T>
  void Read(Image<T>* map) {
    *map = Image<T>(header_.width, header_.height);
    stream_.read(reinterpret_cast<char*>(map->data()), static_cast<std::streamsize>(map->size() * sizeof(T)));
    if (!stream_) FailDamaged(path_);
  }

 private:
  std::filesystem::path path_;
  std::ifstream stream_;
  Header header_;
};

}  // namespace

bool IsWholeWorkFile(const std::filesystem::path& path) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  Header header;
  file.read(reinterpret_cast<char*>(&header), sizeof(header));
  return !error && file && IsValid(header, bytes);
}

void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate) {
  const Header header = {Content::kEstimate, estimate.planes.width(), estimate.planes.height(), 0};
  WriteMaps(path, header, estimate.planes, estimate.cost);
}

EstimateState ReadEstimate(const std::filesystem::path& path, int width, int height) {
  MapReader reader(path, Content::kEstimate);
  if (reader.header().width != width || reader.header().height != height) FailDamaged(path);
  EstimateState estimate;
  reader.Read(&estimate.planes);
  reader.Read(&estimate.cost);
  return estimate;
}

void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps) {
  const Header header = {Content::kFinalMaps, maps.depth.width(), maps.depth.height(), maps.confidence.empty() ? 0 : 1};
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
  return maps;
}

}  // namespace acmp
