// PCD files, as point_cloud_library describes them: ASCII, binary, and binary_compressed (LZF).

#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <sstream>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/dataset/map_io.h"
#include "input_file.h"

namespace acmp {
namespace {

constexpr size_t kMaxPcdLine = 1 << 16;
constexpr size_t kMaxHeaderLines = 100;
constexpr uint64_t kMaxFields = 1000, kMaxFieldBytes = 1 << 20;
constexpr uint64_t kMaxLzfRatio = 88;  ///< three bytes stand for at most 264

struct Field {
  uint64_t bytes = 0;   ///< all of its numbers
  uint64_t offset = 0;  ///< bytes from a point's begin
  uint64_t word = 0;    ///< its first word in an ASCII line
};

struct PcdHeader {
  std::map<std::string, std::vector<std::string>> lines;  ///< words by keyword
  std::array<Field, 3> coordinates;
  uint64_t point_bytes = 0, point_words = 0, points = 0;
};

/// To the end of the file where it has no line end; at that end an empty line.
std::string NextLine(BinaryReader* file) {
  std::string line;
  while (file->remaining() > 0) {
    const char c = file->Read<char>("PCD file");
    if (c == '\n') break;
    if (line.size() == kMaxPcdLine) file->Fail(Concat("a line is longer than ", kMaxPcdLine, " characters"));
    line.push_back(c);
  }
  return line;
}

uint64_t ToCount(const BinaryReader& file, const std::string& keyword, const std::string& word) {
  constexpr size_t kMaxDigits = 10;
  if (word.empty() || word.size() > kMaxDigits || word.find_first_not_of("0123456789") != std::string::npos) {
    file.Fail(Concat(keyword, " \"", word, "\": must be a whole number of at most ", kMaxDigits, " digits"));
  }
  return std::stoull(word);
}

const std::vector<std::string>& Words(const BinaryReader& file, const PcdHeader& header, const char* keyword,
                                      size_t count) {
  const auto& words = header.lines.at(keyword);
  if (words.size() != count) file.Fail(Concat(keyword, " has ", words.size(), " entries: must have ", count));
  return words;
}

void PlaceFields(const BinaryReader& file, PcdHeader* header) {
  const std::vector<std::string>& names = header->lines.at("FIELDS");
  if (names.size() > kMaxFields) file.Fail(Concat("FIELDS has ", names.size(), " entries: at most ", kMaxFields));
  const auto& sizes = Words(file, *header, "SIZE", names.size());
  const auto& types = Words(file, *header, "TYPE", names.size());
  const bool has_counts = header->lines.count("COUNT") > 0;
  std::array<bool, 3> found = {};
  for (size_t i = 0; i < names.size(); ++i) {
    const uint64_t size = ToCount(file, "SIZE", sizes[i]);
    const uint64_t count = has_counts ? ToCount(file, "COUNT", Words(file, *header, "COUNT", names.size())[i]) : 1;
    if (size > 8 || count > kMaxFieldBytes / 8) file.Fail(Concat("SIZE ", size, " COUNT ", count, ": too large"));
    const Field field = {size * count, header->point_bytes, header->point_words};
    header->point_bytes += field.bytes;
    header->point_words += count;
    if (names[i].size() != 1 || names[i] < "x" || names[i] > "z") continue;
    if ((size != sizeof(float) && size != sizeof(double)) || count != 1 || types[i] != "F") {
      file.Fail(Concat("field ", names[i], " must be one float of 32 or 64 bits (SIZE 4 or 8, TYPE F)"));
    }
    const auto axis = static_cast<size_t>(names[i][0] - 'x');
    header->coordinates[axis] = field;
    found[axis] = true;
  }
  for (size_t axis = 0; axis < found.size(); ++axis) {
    if (!found[axis]) file.Fail(Concat("there is no field ", "xyz"[axis]));
  }
}

PcdHeader ReadPcdHeader(BinaryReader* file) {
  PcdHeader header;
  const auto missing = [&]() -> const char* {
    for (const char* keyword : {"DATA", "FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT"}) {
      if (header.lines.count(keyword) == 0) return keyword;
    }
    return nullptr;
  };
  for (size_t i = 0; i < kMaxHeaderLines && header.lines.count("DATA") == 0 && file->remaining() > 0; ++i) {
    std::istringstream line(NextLine(file));
    std::string keyword, word;
    if (!(line >> keyword) || keyword[0] == '#') continue;
    std::vector<std::string>& words = header.lines[keyword];
    for (words.clear(); line >> word;) words.push_back(word);
  }
  if (const char* keyword = missing()) file->Fail(Concat("no PCD file: its header has no line ", keyword));
  PlaceFields(*file, &header);
  header.points = ToCount(*file, "WIDTH", Words(*file, header, "WIDTH", 1)[0]);
  const uint64_t height = ToCount(*file, "HEIGHT", Words(*file, header, "HEIGHT", 1)[0]);
  if (height > 0 && header.points > UINT32_MAX / height) file->Fail("WIDTH x HEIGHT: too many points");
  header.points *= height;
  return header;
}

using Positions = std::vector<std::array<double, 3>>;

Positions ReadAscii(const PcdHeader& header, BinaryReader* file) {
  file->ExpectRemaining(header.points, header.point_words, "PCD points");  // a digit each, before memory is asked for
  const ClassicLocale point;
  Positions positions(header.points);
  for (auto& position : positions) {
    std::istringstream line(NextLine(file));
    std::string word;
    for (uint64_t i = 0; i < header.point_words; ++i) {
      if (!(line >> word)) file->Fail(Concat("a point has ", i, " numbers: must have ", header.point_words));
      for (size_t axis = 0; axis < position.size(); ++axis) {
        if (header.coordinates[axis].word != i) continue;
        char* end = nullptr;
        position[axis] = std::strtod(word.c_str(), &end);
        if (end == word.c_str() || *end != '\0') file->Fail(Concat("\"", word, "\": must be a number"));
      }
    }
  }
  return positions;
}

template <class T>
double ReadNumber(const char* source) {
  T number;
  std::memcpy(&number, source, sizeof(T));
  return static_cast<double>(number);
}

/// @param stride bytes from one point to the next of the same coordinate. @param begin of each coordinate
Positions Unpack(const std::vector<char>& bytes, const PcdHeader& header, const std::array<uint64_t, 3>& begin,
                 const std::array<uint64_t, 3>& stride) {
  Positions positions(header.points);
  for (size_t axis = 0; axis < begin.size(); ++axis) {
    const auto read = header.coordinates[axis].bytes == sizeof(float) ? ReadNumber<float> : ReadNumber<double>;
    for (uint64_t i = 0; i < header.points; ++i) {
      positions[i][axis] = read(bytes.data() + begin[axis] + i * stride[axis]);
    }
  }
  return positions;
}

/// LZF: a byte below 32 and as many bytes more, or three bits of length and thirteen of distance of what is repeated.
std::vector<char> Decompress(const BinaryReader& file, const std::vector<char>& source, uint64_t bytes) {
  std::vector<char> target;
  target.reserve(bytes);
  size_t at = 0;
  const auto next = [&] {
    if (at == source.size()) file.Fail("the compressed points are truncated");
    return static_cast<unsigned char>(source[at++]);
  };
  while (at < source.size()) {
    const unsigned control = next();
    if (control < 32) {
      for (unsigned i = 0; i <= control; ++i) target.push_back(static_cast<char>(next()));
    } else {
      const unsigned length = (control >> 5U) == 7 ? 9U + next() : (control >> 5U) + 2;
      const size_t distance = ((control & 31U) << 8U) + next() + 1;
      if (distance > target.size()) file.Fail("the compressed points repeat what lies before them");
      for (unsigned i = 0; i < length; ++i) target.push_back(target[target.size() - distance]);
    }
    if (target.size() > bytes) break;
  }
  if (target.size() != bytes) file.Fail("the compressed points have another length than their header says");
  return target;
}

Positions ReadBinary(const PcdHeader& header, BinaryReader* file) {
  file->ExpectRemaining(header.points, header.point_bytes, "PCD points");
  std::vector<char> bytes(header.points * header.point_bytes);
  file->ReadBytes(bytes.data(), bytes.size(), "PCD points");
  const auto& xyz = header.coordinates;
  const uint64_t step = header.point_bytes;
  return Unpack(bytes, header, {xyz[0].offset, xyz[1].offset, xyz[2].offset}, {step, step, step});
}

/// The numbers of one field after those of the other.
Positions ReadCompressed(const PcdHeader& header, BinaryReader* file) {
  const uint64_t compressed = file->Read<uint32_t>("PCD points"), bytes = file->Read<uint32_t>("PCD points");
  file->ExpectRemaining(compressed, 1, "PCD points");
  if (bytes != header.points * header.point_bytes || bytes / kMaxLzfRatio > compressed) {
    file->Fail(Concat("the compressed points say that they have ", bytes, " bytes: must have ",
                      header.points * header.point_bytes, ", and at most ", kMaxLzfRatio,
                      " times as many as the file"));
  }
  std::vector<char> source(compressed);
  file->ReadBytes(source.data(), source.size(), "PCD points");
  const auto& xyz = header.coordinates;
  std::array<uint64_t, 3> begin{};
  for (size_t axis = 0; axis < begin.size(); ++axis) begin[axis] = header.points * xyz[axis].offset;
  return Unpack(Decompress(*file, source, bytes), header, begin, {xyz[0].bytes, xyz[1].bytes, xyz[2].bytes});
}

}  // namespace

PointCloud ReadPcd(const std::filesystem::path& path, size_t* not_finite, ReadOrigin* origin) {
  BinaryReader file(path);
  const PcdHeader header = ReadPcdHeader(&file);
  const std::string kind = Words(file, header, "DATA", 1)[0];
  if (kind != "ascii" && kind != "binary" && kind != "binary_compressed") {
    file.Fail(Concat("DATA ", kind, ": must be ascii, binary or binary_compressed"));
  }
  const Positions positions = kind == "ascii"    ? ReadAscii(header, &file)
                              : kind == "binary" ? ReadBinary(header, &file)
                                                 : ReadCompressed(header, &file);
  PointCloud points;
  points.reserve(positions.size());
  for (const auto& [x, y, z] : positions) {
    if (!std::isfinite(x) || !std::isfinite(y) || !std::isfinite(z)) continue;
    points.emplace_back();
    points.back().position = FromOrigin({x, y, z}, origin);
  }
  *not_finite = positions.size() - points.size();
  return points;
}

}  // namespace acmp
