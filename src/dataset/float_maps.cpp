#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "image_codec_private.h"
#include "input_file.h"

namespace acmp {
namespace {

constexpr size_t kMaxHeaderLine = 200;
constexpr float kCountsPerUnit = 1000.0f;
constexpr int32_t kDmbFloat = 1;

static_assert(sizeof(Vec3f) == 3 * sizeof(float), "maps are read and written as plain floats");

template <class T>
constexpr int kChannels = sizeof(T) / sizeof(float);

void SwapBytes(float* values, size_t count) {
  for (size_t i = 0; i < count; ++i) {
    auto* bytes = reinterpret_cast<unsigned char*>(values + i);
    std::reverse(bytes, bytes + sizeof(float));
  }
}

struct PfmHeader {
  int width = 0;
  int height = 0;
  bool big_endian = false;
};

double ParsePfmScale(const std::string& text, const BinaryReader& file) {
  const ClassicLocale point;
  double scale = 0;
  char extra = 0;
  if (std::sscanf(text.c_str(), "%lf %c", &scale, &extra) != 1 || !std::isfinite(scale) || scale == 0) {
    file.Fail(Concat("PFM scale \"", text, "\": must be a number other than 0"));
  }
  return scale;
}

PfmHeader ReadPfmHeader(const std::filesystem::path& path, int channels, BinaryReader* file) {
  const std::string magic = file->ReadLine(kMaxHeaderLine, "PFM magic");
  const std::string expected = channels == 1 ? "Pf" : "PF";
  if (magic != expected) {
    file->Fail(Concat("PFM magic \"", magic.substr(0, 8), "\": must be ", expected, " (", channels, " channel(s))"));
  }
  const std::string size = file->ReadLine(kMaxHeaderLine, "PFM size");
  long long width = 0;
  long long height = 0;
  char extra = 0;
  if (std::sscanf(size.c_str(), "%lld %lld %c", &width, &height, &extra) != 2 || width <= 0 || height <= 0) {
    file->Fail(Concat("PFM size \"", size, "\": must be two positive whole numbers"));
  }
  CheckImageSize(path, width, height);
  const double scale = ParsePfmScale(file->ReadLine(kMaxHeaderLine, "PFM scale"), *file);
  return {static_cast<int>(width), static_cast<int>(height), scale > 0};
}

template <class T>
Image<T> ReadPfmAs(const std::filesystem::path& path) {
  BinaryReader file(path);
  const PfmHeader header = ReadPfmHeader(path, kChannels<T>, &file);
  file.ExpectRemaining(static_cast<uint64_t>(header.width) * header.height, sizeof(T), "PFM pixels");
  Image<T> map(header.width, header.height);
  for (int row = header.height - 1; row >= 0; --row) {
    file.ReadBytes(&map(0, row), sizeof(T) * header.width, "PFM pixels");
  }
  file.ExpectEnd();
  if (header.big_endian) SwapBytes(reinterpret_cast<float*>(map.data()), map.size() * kChannels<T>);
  return map;
}

template <class T>
void WritePfmAs(const std::filesystem::path& path, const ImageView<const T>& map) {
  AtomicFile file(path);
  file.Write(Concat(kChannels<T> == 1 ? "Pf" : "PF", "\n", map.width, " ", map.height, "\n-1.0\n"));
  for (int row = map.height - 1; row >= 0; --row) file.Write(&map(0, row), sizeof(T) * map.width);
  file.Commit();
}

}  // namespace

Image<float> ReadPfm(const std::filesystem::path& path) { return ReadPfmAs<float>(path); }
NormalMap ReadPfmNormals(const std::filesystem::path& path) { return ReadPfmAs<Vec3f>(path); }
void WritePfm(const std::filesystem::path& path, const ImageView<const float>& map) { WritePfmAs(path, map); }
void WritePfm(const std::filesystem::path& path, const ImageView<const Vec3f>& map) { WritePfmAs(path, map); }

Image<float> ReadDmb(const std::filesystem::path& path) {
  BinaryReader file(path);
  const auto type = file.Read<int32_t>("dmb type");
  const auto height = file.Read<int32_t>("dmb height");
  const auto width = file.Read<int32_t>("dmb width");
  const auto channels = file.Read<int32_t>("dmb channels");
  if (type != kDmbFloat || channels != 1) {
    file.Fail(Concat("dmb type ", type, " with ", channels, " channel(s): must be type 1 (float32) with 1 channel"));
  }
  if (width <= 0 || height <= 0) file.Fail(Concat("dmb size ", width, " x ", height, ": must be positive"));
  CheckImageSize(path, width, height);
  file.ExpectRemaining(static_cast<uint64_t>(width) * height, sizeof(float), "dmb pixels");
  Image<float> map(width, height);
  file.ReadBytes(map.data(), map.size() * sizeof(float), "dmb pixels");
  file.ExpectEnd();
  return map;
}

void WriteDmb(const std::filesystem::path& path, const ImageView<const float>& map) {
  AtomicFile file(path);
  const int32_t header[4] = {kDmbFloat, map.height, map.width, 1};
  file.Write(header, sizeof(header));
  for (int row = 0; row < map.height; ++row) file.Write(&map(0, row), sizeof(float) * map.width);
  file.Commit();
}

size_t WriteDepthPng(const std::filesystem::path& path, const ImageView<const float>& depth) {
  constexpr float kMaxCount = 65535.0f;
  Image<uint16_t> counts(depth.width, depth.height);
  size_t too_far = 0;
  for (int row = 0; row < depth.height; ++row) {
    for (int col = 0; col < depth.width; ++col) {
      const float count = std::round(depth(col, row) * kCountsPerUnit);
      if (!(count > 0)) continue;
      if (count > kMaxCount) {
        ++too_far;
      } else {
        counts(col, row) = static_cast<uint16_t>(count);
      }
    }
  }
  WritePng16(path, counts);
  return too_far;
}

DepthMap ReadDepth(const std::filesystem::path& path, double png_unit) {
  const std::string extension = LowerExtension(path);
  DepthMap depth;
  if (extension == ".pfm") {
    depth = ReadPfm(path);
  } else if (extension == ".dmb") {
    depth = ReadDmb(path);
  } else if (extension == ".png") {
    const Image<uint16_t> counts = ReadPng16(path);
    depth = DepthMap(counts.width(), counts.height());
    const auto unit = static_cast<float>(png_unit);
    std::transform(counts.begin(), counts.end(), depth.begin(), [unit](uint16_t count) { return count / unit; });
  } else {
    throw InvalidInputError(
        Concat(path.string(), ": depth file extension \"", extension, "\": must be .pfm, .dmb or .png"));
  }
  for (float& z : depth) {
    if (!(std::isfinite(z) && z > 0)) z = 0;
  }
  return depth;
}

}  // namespace acmp
