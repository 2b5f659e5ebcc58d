// Files of clouds and meshes.

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/fusion/label_votes.h"
#include "acmp_mapping/geometry/local_origin.h"
#include "input_file.h"

namespace acmp {
namespace {

constexpr size_t kMaxPlyLine = 4096;
constexpr size_t kTriangleBytes = 1 + 3 * sizeof(uint32_t);

/// A number type of the format: its size, and how one is read from a binary body.
struct Type {
  size_t bytes;
  double (*read)(BinaryReader*);
};

template <class T>
constexpr Type TypeOf() {
  return {sizeof(T), [](BinaryReader* file) { return static_cast<double>(file->Read<T>("PLY body")); }};
}

Type ParseType(const BinaryReader& file, const std::string& name) {
  static const std::map<std::string, Type> types = {
      {"char", TypeOf<int8_t>()},     {"int8", TypeOf<int8_t>()},     {"uchar", TypeOf<uint8_t>()},
      {"uint8", TypeOf<uint8_t>()},   {"short", TypeOf<int16_t>()},   {"int16", TypeOf<int16_t>()},
      {"ushort", TypeOf<uint16_t>()}, {"uint16", TypeOf<uint16_t>()}, {"int", TypeOf<int32_t>()},
      {"int32", TypeOf<int32_t>()},   {"uint", TypeOf<uint32_t>()},   {"uint32", TypeOf<uint32_t>()},
      {"float", TypeOf<float>()},     {"float32", TypeOf<float>()},   {"double", TypeOf<double>()},
      {"float64", TypeOf<double>()}};
  const auto found = types.find(name);
  if (found == types.end()) file.Fail(Concat("PLY property type \"", name, "\" is unknown"));
  return found->second;
}

struct Property {
  std::string name;
  Type type;
  bool is_list = false;
  Type count_type = {};  ///< of a list
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
};

struct PlyHeader {
  std::string format;
  std::vector<Element> elements;
};

Property ParseProperty(const BinaryReader& file, std::istringstream* words) {
  std::string type;
  Property property;
  *words >> type;
  property.is_list = type == "list";
  if (property.is_list) {
    std::string count_type;
    *words >> count_type >> type;
    property.count_type = ParseType(file, count_type);
  }
  property.type = ParseType(file, type);
  if (!(*words >> property.name)) file.Fail("PLY property without a name");
  return property;
}

void ParseHeaderLine(const BinaryReader& file, const std::string& line, PlyHeader* header) {
  std::istringstream words(line);
  words.imbue(std::locale::classic());
  std::string keyword;
  words >> keyword;
  if (keyword == "format") {
    words >> header->format;
    if (header->format != "ascii" && header->format != "binary_little_endian") {
      file.Fail(Concat("PLY format \"", header->format, "\": must be ascii or binary_little_endian"));
    }
  } else if (keyword == "element") {
    Element element;
    int64_t count = -1;
    if (!(words >> element.name >> count) || count < 0) file.Fail("PLY element without a name or a count >= 0");
    element.count = static_cast<uint64_t>(count);
    header->elements.push_back(std::move(element));
  } else if (keyword == "property") {
    if (header->elements.empty()) file.Fail("PLY property before any element");
    header->elements.back().properties.push_back(ParseProperty(file, &words));
  } else if (keyword != "comment" && keyword != "obj_info" && !keyword.empty()) {
    file.Fail(Concat("PLY header keyword \"", keyword.substr(0, 40), "\" is unknown"));
  }
}

PlyHeader ReadPlyHeader(BinaryReader* file) {
  if (file->ReadLine(kMaxPlyLine, "PLY magic") != "ply") file->Fail("not a PLY file: the first line must be \"ply\"");
  PlyHeader header;
  for (std::string line; line != "end_header"; line = file->ReadLine(kMaxPlyLine, "PLY header")) {
    ParseHeaderLine(*file, line, &header);
  }
  if (header.format.empty()) file->Fail("PLY header without a format line");
  return header;
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

double ReadValue(BinaryReader* file, bool ascii, const Type& type) {
  return ascii ? ReadAsciiValue(file) : type.read(file);
}

/// Reads a record of an element. Calls visit(place of the property, value) for each number; for a list for its length,
/// then for what is in it.
template <class Visit>
void ReadRecord(BinaryReader* file, bool ascii, const Element& element, const Visit& visit) {
  for (size_t i = 0; i < element.properties.size(); ++i) {
    const Property& property = element.properties[i];
    double count = 1;
    if (property.is_list) {
      count = ReadValue(file, ascii, property.count_type);
      visit(i, count);
    }
    for (double n = 0; n < count; ++n) visit(i, ReadValue(file, ascii, property.type));
  }
}

/// Catches corrupt counts before memory is asked for, or time.
void CheckRecordCount(const BinaryReader& file, bool ascii, const Element& element) {
  // A number in text takes two bytes, the last one in the file one.
  uint64_t bytes = ascii ? 2 * element.properties.size() - 1 : 0;
  for (const Property& p : element.properties) bytes += ascii ? 0 : p.is_list ? p.count_type.bytes : p.type.bytes;
  if (!element.properties.empty()) file.ExpectRemaining(element.count, bytes, "PLY body");
}

constexpr std::array<const char*, 11> kFields = {"x",   "y",     "z",    "nx",         "ny",   "nz",
                                                 "red", "green", "blue", "confidence", "label"};

unsigned char ToByte(double value) {
  return static_cast<unsigned char>(value < 0 ? 0 : value > 255 ? 255 : value + 0.5);
}

SurfacePoint ToPoint(const std::array<double, kFields.size() + 1>& v, ReadOrigin* origin) {
  const auto vector = [&v](size_t i) {
    return Vec3f{static_cast<float>(v[i]), static_cast<float>(v[i + 1]), static_cast<float>(v[i + 2])};
  };
  return {FromOrigin({v[0], v[1], v[2]}, origin),
          vector(3),
          {ToByte(v[6]), ToByte(v[7]), ToByte(v[8])},
          v[10] <= kMaxLabel ? ToByte(v[10]) : Label{0},
          static_cast<float>(v[9])};
}

PointCloud ReadVertices(BinaryReader* file, bool ascii, const Element& element, ReadOrigin* origin) {
  std::vector<size_t> fields;  // of each property: its place in kFields, or the end
  for (const Property& property : element.properties) {
    if (property.is_list) file->Fail("PLY vertex has a list: must be single numbers");
    fields.push_back(static_cast<size_t>(std::find(kFields.begin(), kFields.end(), property.name) - kFields.begin()));
  }
  for (size_t field = 0; field < 3; ++field) {
    if (std::count(fields.begin(), fields.end(), field) > 0) continue;
    file->Fail(Concat("PLY vertex has no property \"", kFields[field], "\""));
  }
  PointCloud points;
  points.reserve(element.count);
  for (uint64_t i = 0; i < element.count; ++i) {
    std::array<double, kFields.size() + 1> values = {};  // the last one: of other properties
    ReadRecord(file, ascii, element, [&](size_t property, double value) { values[fields[property]] = value; });
    points.push_back(ToPoint(values, origin));
  }
  return points;
}

/// A face: the vertices of its list, cut into triangles from the first one.
void ReadFace(BinaryReader* file, bool ascii, const Element& element, TriangleMesh* mesh) {
  double corners = 0;
  int read = 0;
  std::array<uint32_t, 3> triangle = {};
  ReadRecord(file, ascii, element, [&](size_t i, double value) {
    const Property& property = element.properties[i];
    if (!property.is_list || property.name.rfind("vertex_ind", 0) != 0) return;  // _indices or _index
    if (corners == 0) {
      corners = value;
      if (!(corners >= 3 && corners <= 255)) file->Fail(Concat("PLY face of ", corners, " vertices: must be 3 to 255"));
      return;
    }
    if (!(value >= 0 && value < static_cast<double>(mesh->vertices.size()))) {
      file->Fail(Concat("PLY face with vertex ", value, ": must be 0 to ", mesh->vertices.size(), " - 1"));
    }
    triangle[std::min(read, 2)] = static_cast<uint32_t>(value);
    if (++read < 3) return;
    mesh->triangles.push_back(triangle);
    triangle[1] = triangle[2];
  });
}

template <class T>
char* Append(char* target, const T& value) {
  std::memcpy(target, &value, sizeof(T));
  return target + sizeof(T);
}

/// How points are written.
struct Layout {
  Eigen::Vector3d origin;   ///< unless it is zero, coordinates are in double
  bool has_labels = false;  ///< else they have none

  bool is_wide() const { return !origin.isZero(0); }
  size_t record_bytes() const {
    return 3 * (is_wide() ? sizeof(double) : sizeof(float)) + 4 * sizeof(float) + 3 + (has_labels ? 1 : 0);
  }
};

/// @param comment a line of the header, or nothing
/// @param elements lines about those after the vertices, or nothing
std::string MakeHeader(size_t points, const Layout& layout, const std::string& comment,
                       const std::string& elements = "", const char* format = "binary_little_endian") {
  const char* type = layout.is_wide() ? "double" : "float";
  return Concat("ply\nformat ", format, " 1.0\n", comment, "element vertex ", points, "\nproperty ", type,
                " x\nproperty ", type, " y\nproperty ", type,
                " z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\n"
                "property uchar green\nproperty uchar blue\nproperty float confidence\n",
                layout.has_labels ? "property uchar label\n" : "", elements, "end_header\n");
}

char* AppendRecord(char* target, const SurfacePoint& point, const Layout& layout) {
  char* end = target;
  if (layout.is_wide()) {
    const Eigen::Vector3d position = InWorld(layout.origin, point.position);
    for (int axis = 0; axis < 3; ++axis) end = Append(end, position[axis]);
  } else {
    end = Append(end, point.position);
  }
  end = Append(end, point.normal);
  end = Append(Append(Append(end, point.color.r), point.color.g), point.color.b);
  end = Append(end, point.confidence);
  return layout.has_labels ? Append(end, point.label) : end;
}

char* AppendRecord(char* target, const std::array<uint32_t, 3>& triangle, const Layout&) {
  return Append(Append(target, uint8_t{3}), triangle);
}

template <class Item>
void WriteRecords(const std::vector<Item>& items, const Layout& layout, size_t record_bytes, AtomicFile* file) {
  constexpr size_t kBlock = 1 << 18;  // records in memory at a time
  std::vector<char> records;
  for (size_t begin = 0; begin < items.size(); begin += kBlock) {
    const size_t count = std::min(kBlock, items.size() - begin);
    records.resize(count * record_bytes);
    tbb::parallel_for(size_t{0}, count,
                      [&](size_t i) { AppendRecord(records.data() + i * record_bytes, items[begin + i], layout); });
    file->Write(records.data(), records.size());
  }
}

void WriteTextPly(const PointCloud& points, const Layout& layout, AtomicFile* file) {
  file->Write(MakeHeader(points.size(), layout, "", "", "ascii"));
  const int digits = TextDigits(layout.origin);
  for (const SurfacePoint& p : points) {
    const Eigen::Vector3d position = InWorld(layout.origin, p.position);
    file->Print("%.*g %.*g %.*g %.9g %.9g %.9g %d %d %d %.9g", digits, position.x(), digits, position.y(), digits,
                position.z(), p.normal.x, p.normal.y, p.normal.z, p.color.r, p.color.g, p.color.b, p.confidence);
    layout.has_labels ? file->Print(" %d\n", p.label) : file->Write("\n");
  }
}

/// Vertices as the points of a cloud, then faces as lists of three vertices.
void WritePlyMesh(const TriangleMesh& mesh, const Eigen::Vector3d& origin, AtomicFile* file) {
  const Layout layout = {origin};
  // int and not uint: some readers know no other type here.
  file->Write(MakeHeader(mesh.vertices.size(), layout, "",
                         Concat("element face ", mesh.triangles.size(), "\nproperty list uchar int vertex_indices\n")));
  WriteRecords(mesh.vertices, layout, layout.record_bytes(), file);
  WriteRecords(mesh.triangles, layout, kTriangleBytes, file);
}

/// Vertices (v x y z red green blue, colours 0..1, which many programs read), normals and triangles.
void WriteObj(const TriangleMesh& mesh, const Eigen::Vector3d& origin, AtomicFile* file) {
  constexpr double kWhite = 255;
  const int digits = TextDigits(origin);
  for (const SurfacePoint& v : mesh.vertices) {
    const Eigen::Vector3d p = InWorld(origin, v.position);
    file->Print("v %.*g %.*g %.*g %.4f %.4f %.4f\n", digits, p.x(), digits, p.y(), digits, p.z(), v.color.r / kWhite,
                v.color.g / kWhite, v.color.b / kWhite);
  }
  for (const SurfacePoint& v : mesh.vertices) {
    file->Print("vn %.4f %.4f %.4f\n", v.normal.x, v.normal.y, v.normal.z);
  }
  for (const auto& triangle : mesh.triangles) {
    const unsigned a = triangle[0] + 1, b = triangle[1] + 1, c = triangle[2] + 1;  // counted from 1
    file->Print("f %u//%u %u//%u %u//%u\n", a, a, b, b, c, c);
  }
}

}  // namespace

void WritePly(const std::filesystem::path& path, const PointCloud& points, const Eigen::Vector3d& origin, bool binary) {
  AtomicFile file(path, Durability::kPowerCut);
  const Layout layout = {origin, HasLabels(points)};
  if (binary) {
    file.Write(MakeHeader(points.size(), layout, ""));
    WriteRecords(points, layout, layout.record_bytes(), &file);
  } else {
    WriteTextPly(points, layout, &file);
  }
  file.Commit();
}

std::string PlyFile::Header() const {
  constexpr size_t kMaxDigits = 20;  // of a 64-bit number
  const std::string padding(kMaxDigits - std::to_string(points_).size(), '-');
  return MakeHeader(points_, {origin_}, Concat("comment ", padding, "\n"));
}

PlyFile::PlyFile(const std::filesystem::path& path, Durability durability, const Eigen::Vector3d& origin)
    : file_(path, durability), origin_(origin) {
  file_.Write(Header());
}

void PlyFile::Append(const PointCloud& points) {
  const Layout layout = {origin_};
  WriteRecords(points, layout, layout.record_bytes(), &file_);
  points_ += points.size();
}

void PlyFile::Commit() {
  file_.Rewind();
  file_.Write(Header());
  file_.Commit();
}

Vec3f FromOrigin(const Eigen::Vector3d& position, ReadOrigin* origin) {
  constexpr double kReach = 10000, kStep = 1024;  // float32 knows a thousandth there
  if (origin && !*origin && position.allFinite()) *origin = LocalOrigin(position, kReach, kStep);
  const Eigen::Vector3f local = (origin && *origin ? Eigen::Vector3d(position - **origin) : position).cast<float>();
  return {local.x(), local.y(), local.z()};
}

TriangleMesh ReadPly(const std::filesystem::path& path, ReadOrigin* origin) {
  const ClassicLocale point;
  BinaryReader file(path);
  const PlyHeader header = ReadPlyHeader(&file);
  const bool ascii = header.format == "ascii";
  TriangleMesh mesh;
  bool has_vertices = false;
  for (const Element& element : header.elements) {
    if (has_vertices && element.name != "face") break;
    CheckRecordCount(file, ascii, element);
    if (element.name == "vertex") {
      mesh.vertices = ReadVertices(&file, ascii, element, origin);
      has_vertices = true;
      continue;
    }
    for (uint64_t i = 0; i < element.count && !element.properties.empty(); ++i) {
      if (has_vertices) {
        ReadFace(&file, ascii, element, &mesh);
      } else {
        ReadRecord(&file, ascii, element, [](size_t, double) {});
      }
    }
  }
  if (!has_vertices) file.Fail("PLY file without a vertex element");
  return mesh;
}

MeshFormat MeshFormatOf(const std::filesystem::path& path) {
  const std::string extension = LowerExtension(path);
  if (extension == ".ply") return MeshFormat::kPly;
  if (extension == ".obj") return MeshFormat::kObj;
  throw InvalidInputError(Concat("mesh ", path, ": must end with .ply or .obj"));
}

void WriteMesh(const std::filesystem::path& path, const TriangleMesh& mesh, MeshFormat format,
               const Eigen::Vector3d& origin) {
  if (mesh.triangles.empty()) throw InvalidInputError("the mesh is empty: nothing was written");
  AtomicFile file(path, Durability::kPowerCut);
  if (format == MeshFormat::kPly) {
    WritePlyMesh(mesh, origin, &file);
  } else {
    WriteObj(mesh, origin, &file);
  }
  file.Commit();
}

}  // namespace acmp
