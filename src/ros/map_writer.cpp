#include "acmp_mapping/ros/map_writer.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>

#include <fcntl.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>
#include <pcl_conversions/pcl_conversions.h>
#include <unistd.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/ros/output_conversion.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

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

/// PCL's writers do not report a disk that fills up: look at what arrived, and force it to the disk.
void CheckWritten(const fs::path& path, size_t points, size_t point_bytes, bool binary) {
  const bool whole = binary ? fs::file_size(path) > points * point_bytes : CountLines(path) > points;
  const int descriptor = whole ? ::open(path.c_str(), O_RDONLY) : -1;
  const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int error = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!whole) throw ProcessingError(Concat(path.string(), ": was not written completely (is the disk full?)"));
  if (!synced) throw ProcessingError(Concat(path.string(), ": ", std::strerror(error)));
}

void WriteWithPcl(const fs::path& path, const PointCloud& map, MapFormat format, bool binary) {
  pcl::PCLPointCloud2 cloud;
  pcl_conversions::moveToPCL(*ToCloudMessage(map, std_msgs::Header()), cloud);
  const Eigen::Vector4f origin = Eigen::Vector4f::Zero();
  const Eigen::Quaternionf orientation = Eigen::Quaternionf::Identity();
  constexpr int kDigits = 9;  // a float32 reads back as written
  int status = 0;
  if (format == MapFormat::kPly) {
    status = pcl::PLYWriter().writeASCII(path.string(), cloud, origin, orientation, kDigits, false);
  } else if (binary) {
    status = pcl::PCDWriter().writeBinary(path.string(), cloud, origin, orientation);
  } else {
    status = pcl::PCDWriter().writeASCII(path.string(), cloud, origin, orientation, kDigits);
  }
  if (status < 0) throw ProcessingError(Concat(path.string(), ": PCL could not write it: ", std::strerror(errno)));
  CheckWritten(path, map.size(), cloud.point_step, binary);
}

}  // namespace

void WriteMap(const fs::path& path, const PointCloud& map, MapFormat format, bool binary) {
  if (map.empty()) throw InvalidInputError("the map is empty: nothing was written");
  CheckPath(path);
  if (format == MapFormat::kPly && binary) return WritePly(path, map);  // whole or absent by itself

  const TemporaryFile temporary(path.string() + ".tmp" + std::to_string(::getpid()));
  try {
    WriteWithPcl(temporary.path(), map, format, binary);
    fs::rename(temporary.path(), path);
  } catch (const pcl::PCLException& error) {
    throw ProcessingError(Concat(path.string(), ": ", error.what()));
  } catch (const fs::filesystem_error& error) {
    throw ProcessingError(error.what());
  }
}

}  // namespace acmp
