#include "acmp_mapping/ros/map_writer.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <fcntl.h>
#include <pcl/io/pcd_io.h>
#include <pcl_conversions/pcl_conversions.h>
#include <unistd.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/ros/output_conversion.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

constexpr int kFloatDigits = 9;  ///< so that a float32 reads back as written

/// Removes the file unless it was moved away.
class TemporaryFile {
 public:
  explicit TemporaryFile(fs::path path) : path_(std::move(path)) {}
  ~TemporaryFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

void CheckPath(const fs::path& path) {
  if (path.empty() || !path.has_filename())
    throw InvalidInputError(Concat("path = \"", path.string(), "\": names no file"));
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!fs::is_directory(folder)) throw InvalidInputError(Concat("path = \"", path.string(), "\": no such folder"));
  if (fs::is_directory(path)) throw InvalidInputError(Concat("path = \"", path.string(), "\": is a folder"));
}

size_t CountLines(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return static_cast<size_t>(std::count(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>(), '\n'));
}

/// PCL's writer does not always report a disk that fills up: look at what arrived, and force it to the disk.
void CheckWritten(const fs::path& path, size_t points) {
  const bool whole = CountLines(path) > points;
  const int descriptor = whole ? ::open(path.c_str(), O_RDONLY) : -1;
  const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int error = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!whole) throw ProcessingError(Concat(path.string(), ": was not written completely (is the disk full?)"));
  if (!synced) throw ProcessingError(Concat(path.string(), ": ", std::strerror(error)));
}

void WriteAsciiPcd(const fs::path& path, const PointCloud& map) {
  const TemporaryFile temporary(path.string() + ".tmp" + std::to_string(::getpid()));
  const std::string name = temporary.path().string();
  try {
    pcl::PCLPointCloud2 cloud;
    pcl_conversions::moveToPCL(*ToCloudMessage(map, std_msgs::Header()), cloud);
    const int status =
        pcl::PCDWriter().writeASCII(name, cloud, Eigen::Vector4f::Zero(), Eigen::Quaternionf::Identity(), kFloatDigits);
    if (status < 0) throw ProcessingError(Concat(name, ": PCL could not write it: ", std::strerror(errno)));
    CheckWritten(name, map.size());
    fs::rename(name, path);
  } catch (const pcl::PCLException& error) {
    throw ProcessingError(Concat(name, ": ", error.what()));
  } catch (const fs::filesystem_error& error) {
    throw ProcessingError(error.what());
  }
}

/// Piece by piece: PCL's writer would need the whole map twice more in memory, and takes 4 GB at most.
void WriteBinaryPcd(const fs::path& path, const PointCloud& map) {
  AtomicFile file(path, Durability::kPowerCut);
  file.Write(
      Concat("# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
             "FIELDS x y z rgb normal_x normal_y normal_z confidence\nSIZE 4 4 4 4 4 4 4 4\n"
             "TYPE F F F F F F F F\nCOUNT 1 1 1 1 1 1 1 1\nWIDTH ",
             map.size(), "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS ", map.size(), "\nDATA binary\n"));
  constexpr size_t kPiece = 4096;
  std::vector<uint8_t> bytes(kPiece * kCloudPointBytes);
  for (size_t i = 0; i < map.size(); i += kPiece) {
    const size_t count = std::min(kPiece, map.size() - i);
    PackPoints(map.data() + i, count, bytes.data());
    file.Write(bytes.data(), count * kCloudPointBytes);
  }
  file.Commit();
}

/// The properties of WritePly. (PCL's ASCII writer keeps six digits only: 10 cm at 100 km from the origin.)
void WriteAsciiPly(const fs::path& path, const PointCloud& map) {
  AtomicFile file(path);
  file.Write(Concat("ply\nformat ascii 1.0\nelement vertex ", map.size(),
                    "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n"
                    "property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
                    "property float confidence\nend_header\n"));
  for (const SurfacePoint& p : map) {
    char line[200];
    const int length =
        std::snprintf(line, sizeof(line), "%.9g %.9g %.9g %.9g %.9g %.9g %d %d %d %.9g\n", p.position.x, p.position.y,
                      p.position.z, p.normal.x, p.normal.y, p.normal.z, p.color.r, p.color.g, p.color.b, p.confidence);
    file.Write(line, static_cast<size_t>(length));
  }
  file.Commit();
}

}  // namespace

void WriteMap(const fs::path& path, const PointCloud& map, MapFormat format, bool binary) {
  if (map.empty()) throw InvalidInputError("the map is empty: nothing was written");
  CheckPath(path);
  if (format == MapFormat::kPly) return binary ? WritePly(path, map) : WriteAsciiPly(path, map);
  return binary ? WriteBinaryPcd(path, map) : WriteAsciiPcd(path, map);
}

}  // namespace acmp
