#include "cloud_file.h"

#include <cmath>
#include <cstring>
#include <fstream>
#include <set>
#include <string>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"

#ifdef ACMP_HAVE_PCL
#include <pcl/PCLPointCloud2.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>
#endif

namespace acmp {

#ifdef ACMP_HAVE_PCL
namespace {

/// Bytes from a point's begin to its coordinate.
size_t OffsetOf(const pcl::PCLPointCloud2& cloud, const char* name, const std::filesystem::path& path) {
  for (const pcl::PCLPointField& field : cloud.fields) {
    if (field.name != name) continue;
    if (field.datatype != pcl::PCLPointField::FLOAT32 || field.count > 1) {
      throw InvalidInputError(Concat(path.string(), ": field ", name, " must be one 32-bit float (SIZE 4, TYPE F)"));
    }
    return field.offset;
  }
  throw InvalidInputError(Concat(path.string(), ": there is no field ", name));
}

/// PCL's reader ends the process where there is no header, and makes points of nothing where it breaks off.
void CheckHeader(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::set<std::string> missing = {"FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "DATA"};
  constexpr int kMaxLines = 100;
  std::string line;
  for (int i = 0; i < kMaxLines && missing.count("DATA") > 0 && std::getline(stream, line); ++i) {
    missing.erase(line.substr(0, line.find(' ')));
  }
  if (!missing.empty()) {
    throw InvalidInputError(Concat(path.string(), ": no PCD file: its header has no line ", *missing.begin()));
  }
}

PointCloud ReadPcd(const std::filesystem::path& path, std::ostream* notes) {
  if (!std::filesystem::is_regular_file(path)) throw InvalidInputError(Concat(path.string(), ": no such file"));
  CheckHeader(path);
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);  // it would print what is thrown here
  pcl::PCLPointCloud2 cloud;
  int code = -1;
  try {
    code = pcl::PCDReader().read(path.string(), cloud);
  } catch (const std::exception& error) {
    throw InvalidInputError(Concat(path.string(), ": ", error.what()));
  }
  const size_t count = static_cast<size_t>(cloud.width) * cloud.height;
  if (code < 0 || cloud.data.size() < count * cloud.point_step) {
    throw InvalidInputError(Concat(path.string(), ": no PCD file, or truncated"));
  }
  const size_t offsets[] = {OffsetOf(cloud, "x", path), OffsetOf(cloud, "y", path), OffsetOf(cloud, "z", path)};
  PointCloud points;
  points.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    float position[3];
    for (int axis = 0; axis < 3; ++axis) {
      std::memcpy(&position[axis], &cloud.data[i * cloud.point_step + offsets[axis]], sizeof(float));
    }
    if (!std::isfinite(position[0] + position[1] + position[2])) continue;
    SurfacePoint point = {};
    point.position = {position[0], position[1], position[2]};
    points.push_back(point);
  }
  if (points.size() < count) {
    *notes << "note: " << path.string() << ": " << count - points.size() << " of " << count
           << " points are not finite and left out\n";
  }
  return points;
}

}  // namespace
#endif

PointCloud ReadCloudFile(const std::filesystem::path& path, std::ostream* notes) {
  if (path.extension() != ".pcd" && path.extension() != ".PCD") return ReadPly(path);
#ifdef ACMP_HAVE_PCL
  return ReadPcd(path, notes);
#else
  (void)notes;
  throw InvalidInputError(
      Concat(path.string(), ": PCD files are read by PCL, without which this was built; save as PLY"));
#endif
}

}  // namespace acmp
