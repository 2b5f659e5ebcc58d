#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <optional>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "input_file.h"

namespace acmp {
namespace {

constexpr size_t kMaxHeaderLine = 4096;
constexpr size_t kRecordBytes = 7 * sizeof(float) + 3;

enum class Type { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

const std::map<std::string, Type>& TypeNames() {
  static const std::map<std::string, Type> names = {
      {"char", Type::kInt8},     {"int8", Type::kInt8},       {"uchar", Type::kUint8},    {"uint8", Type::kUint8},
      {"short", Type::kInt16},   {"int16", Type::kInt16},     {"ushort", Type::kUint16},  {"uint16", Type::kUint16},
      {"int", Type::kInt32},     {"int32", Type::kInt32},     {"uint", Type::kUint32},    {"uint32", Type::kUint32},
      {"float", Type::kFloat32}, {"float32", Type::kFloat32}, {"double", Type::kFloat64}, {"float64", Type::kFloat64}};
  return names;
}

size_t SizeOf(Type type) {
  constexpr std::array<size_t, 8> kSizes = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<size_t>(type)];
}

struct Property {
  std::string name;
  Type type = Type::kFloat32;
  std::optional<Type> list_count_type;  ///< set for a list property
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  bool ascii = false;
  std::vector<Element> elements;
};

Type ParseType(const BinaryReader& file, const std::string& name) {
  const auto found = TypeNames().find(name);
  if (found == TypeNames().end()) file.Fail(Concat("PLY property type \"", name, "\" is unknown"));
  return found->second;
}

Property ParseProperty(const BinaryReader& file, std::istringstream* words) {
  std::string type;
  Property property;
  *words >> type;
  if (type == "list") {
    std::string count_type;
    *words >> count_type >> type;
    property.list_count_type = ParseType(file, count_type);
  }
  property.type = ParseType(file, type);
  if (!(*words >> property.name)) file.Fail("PLY property without a name");
  return property;
}

Element ParseElement(const BinaryReader& file, std::istringstream* words) {
  Element element;
  long long count = -1;
  if (!(*words >> element.name >> count) || count < 0) file.Fail("PLY element without a name or a count >= 0");
  element.count = static_cast<uint64_t>(count);
  return element;
}

void ParseHeaderLine(const BinaryReader& file, const std::string& line, Header* header, bool* has_format) {
  std::istringstream words(line);
  std::string keyword;
  words >> keyword;
  if (keyword == "format") {
    std::string format;
    words >> format;
    if (format != "ascii" && format != "binary_little_endian") {
      file.Fail(Concat("PLY format \"", format, "\": must be ascii or binary_little_endian"));
    }
    header->ascii = format == "ascii";
    *has_format = true;
  } else if (keyword == "element") {
    header->elements.push_back(ParseElement(file, &words));
  } else if (keyword == "property") {
    if (header->elements.empty()) file.Fail("PLY property before any element");
    header->elements.back().properties.push_back(ParseProperty(file, &words));
  } else if (keyword != "comment" && keyword != "obj_info" && !keyword.empty()) {
    file.Fail(Concat("PLY header keyword \"", keyword.substr(0, 40), "\" is unknown"));
  }
}

Header ReadHeader(BinaryReader* file) {
  if (file->ReadLine(kMaxHeaderLine, "PLY magic") != "ply")
    file->Fail("not a PLY file: the first line must be \"ply\"");
  Header header;
  bool has_format = false;
  for (;;) {
    const std::string line = file->ReadLine(kMaxHeaderLine, "PLY header");
    if (line == "end_header") break;
    ParseHeaderLine(*file, line, &header, &has_format);
  }
  if (!has_format) file->Fail("PLY header without a format line");
  return header;
}

template <class T>
double ReadNumber(BinaryReader* file) {
  return static_cast<double>(file->Read<T>("PLY body"));
}

double ReadBinaryValue(BinaryReader* file, Type type) {
  using Function = double (*)(BinaryReader*);
  constexpr std::array<Function, 8> kReaders = {ReadNumber<int8_t>,   ReadNumber<uint8_t>, ReadNumber<int16_t>,
                                                ReadNumber<uint16_t>, ReadNumber<int32_t>, ReadNumber<uint32_t>,
                                                ReadNumber<float>,    ReadNumber<double>};
  return kReaders[static_cast<size_t>(type)](file);
}

double ReadAsciiValue(BinaryReader* file) {
  constexpr size_t kMaxNumber = 60;
  std::string word;
  // The last number may end with the file instead of white space.
  while (file->remaining() > 0 || word.empty()) {
    const char c = file->Read<char>("PLY body");
    const bool space = c == ' ' || c == '\n' || c == '\r' || c == '\t';
    if (space && !word.empty()) break;
    if (!space) word.push_back(c);
    if (word.size() > kMaxNumber) break;
  }
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (end != word.c_str() + word.size()) file->Fail(Concat("\"", word, "\" in the PLY body: must be a number"));
  return value;
}

double ReadValue(BinaryReader* file, bool ascii, Type type) {
  return ascii ? ReadAsciiValue(file) : ReadBinaryValue(file, type);
}

void SkipList(BinaryReader* file, bool ascii, const Property& property) {
  const double count = ReadValue(file, ascii, *property.list_count_type);
  if (!(count >= 0 && count <= 4294967295.0)) file->Fail(Concat("PLY list of ", count, " entries"));
  if (!ascii) {
    file->ExpectRemaining(static_cast<uint64_t>(count), SizeOf(property.type), "PLY list");
    file->Skip(static_cast<uint64_t>(count) * SizeOf(property.type), "PLY list");
    return;
  }
  for (uint64_t i = 0; i < static_cast<uint64_t>(count); ++i) ReadAsciiValue(file);
}

enum Field { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kConfidence, kFields };

int FieldOf(const std::string& name) {
  static const std::array<const char*, kFields> names = {"x",  "y",   "z",     "nx",   "ny",
                                                         "nz", "red", "green", "blue", "confidence"};
  for (int field = 0; field < kFields; ++field) {
    if (name == names[field]) return field;
  }
  return -1;
}

unsigned char ToByte(double value) {
  return static_cast<unsigned char>(value < 0 ? 0 : value > 255 ? 255 : value + 0.5);
}

SurfacePoint ToPoint(const std::array<double, kFields>& v) {
  SurfacePoint point;
  point.position = {static_cast<float>(v[kX]), static_cast<float>(v[kY]), static_cast<float>(v[kZ])};
  point.normal = {static_cast<float>(v[kNx]), static_cast<float>(v[kNy]), static_cast<float>(v[kNz])};
  point.color = {ToByte(v[kRed]), ToByte(v[kGreen]), ToByte(v[kBlue])};
  point.confidence = static_cast<float>(v[kConfidence]);
  return point;
}

// Smallest number of bytes one record can take: catches corrupt counts before memory is asked for.
uint64_t MinRecordBytes(const Element& element, bool ascii) {
  uint64_t bytes = 0;
  for (const Property& property : element.properties) {
    bytes += ascii ? 2 : SizeOf(property.list_count_type.value_or(property.type));
  }
  return ascii && bytes > 0 ? bytes - 1 : bytes;  // the file's last number may have no white space after it
}

void ReadElement(BinaryReader* file, bool ascii, const Element& element, PointCloud* points) {
  if (element.count == 0 || element.properties.empty()) return;
  file->ExpectRemaining(element.count, MinRecordBytes(element, ascii), "PLY body");
  std::vector<int> fields;
  for (const Property& property : element.properties) fields.push_back(FieldOf(property.name));
  if (points) points->reserve(element.count);
  for (uint64_t i = 0; i < element.count; ++i) {
    std::array<double, kFields> values = {};
    for (size_t p = 0; p < fields.size(); ++p) {
      if (element.properties[p].list_count_type) {
        SkipList(file, ascii, element.properties[p]);
        continue;
      }
      const double value = ReadValue(file, ascii, element.properties[p].type);
      if (fields[p] >= 0) values[fields[p]] = value;
    }
    if (points) points->push_back(ToPoint(values));
  }
}

void CheckHasPosition(const BinaryReader& file, const Element& vertex) {
  for (const char* name : {"x", "y", "z"}) {
    bool found = false;
    for (const Property& property : vertex.properties) found |= property.name == name && !property.list_count_type;
    if (!found) file.Fail(Concat("PLY vertex has no property \"", name, "\""));
  }
}

template <class T>
char* Append(char* target, const T& value) {
  std::memcpy(target, &value, sizeof(T));
  return target + sizeof(T);
}

/// @param comment a line of the header, or nothing
std::string MakeHeader(size_t points, const std::string& comment) {
  return Concat("ply\nformat binary_little_endian 1.0\n", comment, "element vertex ", points,
                "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n"
                "property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
                "property float confidence\nend_header\n");
}

/// Calls write(place of the first record, records) for blocks of records as they are in the file.
template <class Write>
void MakeRecords(const PointCloud& points, const Write& write) {
  constexpr size_t kBlock = 1 << 18;  // records in memory at a time
  std::vector<char> records;
  for (size_t begin = 0; begin < points.size(); begin += kBlock) {
    const size_t count = std::min(kBlock, points.size() - begin);
    records.resize(count * kRecordBytes);
    tbb::parallel_for(size_t{0}, count, [&](size_t i) {
      const SurfacePoint& point = points[begin + i];
      char* end = Append(Append(records.data() + i * kRecordBytes, point.position), point.normal);
      end = Append(Append(Append(end, point.color.r), point.color.g), point.color.b);
      Append(end, point.confidence);
    });
    write(begin, records);
  }
}

}  // namespace

void WritePly(const std::filesystem::path& path, const PointCloud& points) {
  AtomicFile file(path, Durability::kPowerCut);
  file.Write(MakeHeader(points.size(), ""));
  MakeRecords(points, [&](size_t, const std::vector<char>& records) { file.Write(records.data(), records.size()); });
  file.Commit();
}

std::string PlyFile::Header() const {
  constexpr size_t kMaxDigits = 20;  // of a 64-bit number
  const std::string padding(kMaxDigits - std::to_string(points_).size(), '-');
  return MakeHeader(points_, Concat("comment ", padding, "\n"));
}

PlyFile::PlyFile(const std::filesystem::path& path)
    : file_(path, Durability::kPowerCut), header_bytes_(Header().size()) {}

size_t PlyFile::Reserve(size_t points) {
  const size_t first = points_;
  points_ += points;
  return first;
}

void PlyFile::WriteAt(size_t first, const PointCloud& points) {
  const size_t offset = header_bytes_ + first * kRecordBytes;
  MakeRecords(points, [&](size_t begin, const std::vector<char>& records) {
    file_.WriteAt(offset + begin * kRecordBytes, records.data(), records.size());
  });
  if (!points.empty()) file_.StartWriteback(offset, points.size() * kRecordBytes);  // 0 bytes would be all that follow
}

void PlyFile::Commit() {
  file_.Write(Header());
  file_.Commit();
}

PointCloud ReadPly(const std::filesystem::path& path) {
  BinaryReader file(path);
  const Header header = ReadHeader(&file);
  PointCloud points;
  bool has_vertex = false;
  for (const Element& element : header.elements) {
    const bool is_vertex = element.name == "vertex";
    if (is_vertex) CheckHasPosition(file, element);
    has_vertex |= is_vertex;
    ReadElement(&file, header.ascii, element, is_vertex ? &points : nullptr);
  }
  if (!has_vertex) file.Fail("PLY file without a vertex element");
  return points;
}

}  // namespace acmp
