#include "waiting_clouds.h"

#include <filesystem>
#include <fstream>
#include <type_traits>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<SurfacePoint>, "files have points as they are in memory");

size_t BytesOf(const PointCloud& cloud) { return cloud.size() * sizeof(SurfacePoint); }

PointCloud ReadPoints(const std::filesystem::path& path, size_t points) {
  std::ifstream file(path, std::ios::binary);
  PointCloud cloud(points);
  file.read(reinterpret_cast<char*>(cloud.data()), static_cast<std::streamsize>(BytesOf(cloud)));
  if (!file) throw ProcessingError(Concat("cannot read the ", points, " points of ", path.string()));
  return cloud;
}

}  // namespace

void WaitingClouds::Put(int index, PointCloud cloud) {
  if (KeepInMemory(index, &cloud)) return;
  const std::filesystem::path path = folder_.WorkFile(kKind, index);
  MakeFolder(path.parent_path());
  AtomicFile file(path);
  file.Write(cloud.data(), BytesOf(cloud));
  file.Commit();
  const std::lock_guard<std::mutex> lock(mutex_);
  points_in_file_[index] = cloud.size();
}

bool WaitingClouds::KeepInMemory(int index, PointCloud* cloud) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (bytes_ + BytesOf(*cloud) > max_bytes_) return false;
  bytes_ += BytesOf(*cloud);
  in_memory_[index] = std::move(*cloud);
  return true;
}

size_t WaitingClouds::NumPoints(int index) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = in_memory_.find(index);
  return found != in_memory_.end() ? found->second.size() : points_in_file_.at(index);
}

PointCloud WaitingClouds::Take(int index) {
  size_t points = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = in_memory_.find(index); found != in_memory_.end()) {
      PointCloud cloud = std::move(found->second);
      bytes_ -= BytesOf(cloud);
      in_memory_.erase(found);
      return cloud;
    }
    points = points_in_file_.at(index);
    points_in_file_.erase(index);
  }
  const std::filesystem::path path = folder_.WorkFile(kKind, index);
  PointCloud cloud = ReadPoints(path, points);
  std::error_code ignored;  // what is left goes with the work folder
  std::filesystem::remove(path, ignored);
  return cloud;
}

}  // namespace acmp
