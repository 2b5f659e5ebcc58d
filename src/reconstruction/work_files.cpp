#include "reconstruct_work_files.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/patch_match/patch_match_options.h"

namespace acmp {
namespace {

constexpr uint32_t kEstimateMagic = 0x32545345;  // "EST2"
constexpr uint32_t kMapsMagic = 0x3150414d;      // "MAP1"

struct Header {
  uint32_t magic = 0;
  int32_t width = 0;   ///< px
  int32_t height = 0;  ///< px
  int32_t sources = 0;
  int32_t source[kMaxSourceViews] = {};
  int32_t has_confidence = 0;
  int32_t padding[3] = {};  ///< maps begin at a multiple of 16 bytes
};
static_assert(sizeof(Header) % alignof(PlaneHypothesis) == 0);

template <class T>
void WritePixels(const Image<T>& image, AtomicFile* file) {
  file->Write(image.data(), image.size() * sizeof(T));
}

[[noreturn]] void FailDamaged(const std::filesystem::path& path) {
  throw ProcessingError(Concat("the work file ", path.string(), " is damaged: give --overwrite to start afresh"));
}

template <class T>
Image<T> ReadPixels(std::ifstream* file, int width, int height) {
  Image<T> image(width, height);
  file->read(reinterpret_cast<char*>(image.data()), static_cast<std::streamsize>(image.size() * sizeof(T)));
  return image;
}

std::ifstream OpenEstimate(const std::filesystem::path& path, int width, int height) {
  std::ifstream file(path, std::ios::binary);
  Header header;
  file.read(reinterpret_cast<char*>(&header), sizeof(header));
  if (!file || header.magic != kEstimateMagic || header.width != width || header.height != height) FailDamaged(path);
  return file;
}

/// Takes views one after the other from a block of memory.
class Slicer {
 public:
  Slicer(const char* data, int width, int height) : data_(data), width_(width), height_(height) {}

  template <class T>
  ImageView<const T> Next() {
    const ImageView<const T> view{reinterpret_cast<const T*>(data_), width_, height_, width_};
    data_ += sizeof(T) * static_cast<size_t>(width_) * height_;
    return view;
  }

 private:
  const char* data_;
  int width_;
  int height_;
};

size_t BytesOf(const Header& header) {
  const size_t floats = 1 + 3 + 1 + (header.has_confidence ? 1 : 0);
  const size_t per_pixel =
      header.magic == kEstimateMagic ? sizeof(PlaneHypothesis) + sizeof(float) : floats * sizeof(float) + sizeof(Rgb);
  return sizeof(Header) + static_cast<size_t>(header.width) * header.height * per_pixel;
}

bool IsValid(const Header& header, uint32_t magic, size_t bytes) {
  return header.magic == magic && header.width > 0 && header.height > 0 && header.sources >= 0 &&
         header.sources <= kMaxSourceViews && BytesOf(header) == bytes;
}

}  // namespace

bool IsWholeWorkFile(const std::filesystem::path& path) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  Header header;
  file.read(reinterpret_cast<char*>(&header), sizeof(header));
  return !error && file && (IsValid(header, kEstimateMagic, bytes) || IsValid(header, kMapsMagic, bytes));
}

void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate) {
  Header header;
  header.magic = kEstimateMagic;
  header.width = estimate.planes.width();
  header.height = estimate.planes.height();
  AtomicFile file(path);
  file.Write(&header, sizeof(header));
  WritePixels(estimate.planes, &file);
  WritePixels(estimate.cost, &file);
  file.Commit();
}

EstimateState ReadEstimate(const std::filesystem::path& path, int width, int height) {
  std::ifstream file = OpenEstimate(path, width, height);
  EstimateState estimate;
  estimate.planes = ReadPixels<PlaneHypothesis>(&file, width, height);
  estimate.cost = ReadPixels<float>(&file, width, height);
  if (!file || file.peek() != std::ifstream::traits_type::eof()) FailDamaged(path);
  return estimate;
}

void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps) {
  CheckRange("number of source views", static_cast<int>(maps.sources.size()), 0, kMaxSourceViews);
  Header header;
  header.magic = kMapsMagic;
  header.width = maps.depth.width();
  header.height = maps.depth.height();
  header.sources = static_cast<int32_t>(maps.sources.size());
  std::copy(maps.sources.begin(), maps.sources.end(), header.source);
  header.has_confidence = maps.confidence.empty() ? 0 : 1;
  AtomicFile file(path);
  file.Write(&header, sizeof(header));
  WritePixels(maps.depth, &file);
  WritePixels(maps.normal, &file);
  WritePixels(maps.cost, &file);
  WritePixels(maps.confidence, &file);
  WritePixels(maps.color, &file);
  file.Commit();
}

StoredFinalMaps::StoredFinalMaps(const std::filesystem::path& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) throw ProcessingError(Concat("cannot read ", path.string(), ": ", std::strerror(errno)));
  struct stat status = {};
  const bool has_size = fstat(descriptor, &status) == 0 && status.st_size >= static_cast<off_t>(sizeof(Header));
  void* data = MAP_FAILED;
  if (has_size) data = mmap(nullptr, static_cast<size_t>(status.st_size), PROT_READ, MAP_PRIVATE, descriptor, 0);
  close(descriptor);
  if (data == MAP_FAILED) FailDamaged(path);
  bytes_ = static_cast<size_t>(status.st_size);
  Header header;
  std::memcpy(&header, data, sizeof(header));
  if (!IsValid(header, kMapsMagic, bytes_)) {
    munmap(data, bytes_);
    FailDamaged(path);
  }
  data_ = data;
  Slicer slicer(static_cast<const char*>(data) + sizeof(Header), header.width, header.height);
  depth_ = slicer.Next<float>();
  normal_ = slicer.Next<Vec3f>();
  cost_ = slicer.Next<float>();
  if (header.has_confidence) confidence_ = slicer.Next<float>();
  color_ = slicer.Next<Rgb>();
  sources_.assign(header.source, header.source + header.sources);
}

StoredFinalMaps::StoredFinalMaps(std::shared_ptr<const FinalMaps> maps)
    : owner_(std::move(maps)),
      depth_(owner_->depth.View()),
      normal_(owner_->normal.View()),
      cost_(owner_->cost.View()),
      confidence_(owner_->confidence.View()),
      color_(owner_->color.View()),
      sources_(owner_->sources) {}

StoredFinalMaps::~StoredFinalMaps() {
  if (data_) munmap(data_, bytes_);
}

StoredFinalMaps::StoredFinalMaps(StoredFinalMaps&& other) noexcept
    : owner_(std::move(other.owner_)),
      data_(std::exchange(other.data_, nullptr)),
      bytes_(other.bytes_),
      depth_(other.depth_),
      normal_(other.normal_),
      cost_(other.cost_),
      confidence_(other.confidence_),
      color_(other.color_),
      sources_(std::move(other.sources_)) {}

}  // namespace acmp
