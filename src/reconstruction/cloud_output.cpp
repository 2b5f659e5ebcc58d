#include "cloud_output.h"

#include <utility>

#include "acmp_mapping/common/error.h"
#include "work_files.h"

namespace acmp {

CloudOutput::CloudOutput(const ReconstructRun& run) : interrupt_(run.interrupt) {
  if (run.options.tile_size) {
    tiles_ =
        std::make_unique<TiledCloud>(run.folder, *run.options.tile_size, run.options.CloudBytes(), run.plan.origin);
  } else {
    file_ = std::make_unique<PlyFile>(run.folder->path() / "fused.ply", Durability::kPowerCut, run.plan.origin);
  }
}

void CloudOutput::WriteAt(size_t first, const PointCloud& points) {
  if (file_) return file_->WriteAt(first, points);
  tiles_->Add(points);
}

void CloudOutput::Commit() {
  if (file_) return file_->Commit();
  tiles_->Commit(interrupt_);
}

CloudSize CloudOutput::size() const {
  if (file_) return {file_->points(), std::nullopt};
  return {tiles_->points(), tiles_->tiles()};
}

void WaitingClouds::Put(int index, PointCloud cloud) {
  const size_t points = cloud.size(), bytes = points * sizeof(SurfacePoint);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (bytes_ + bytes <= max_bytes_) {
      bytes_ += bytes;
      waiting_[index] = {points, std::move(cloud)};
      return;
    }
  }
  WritePoints(FileOf(index), cloud);
  const std::lock_guard<std::mutex> lock(mutex_);
  waiting_[index] = {points, {}};
}

size_t WaitingClouds::NumPoints(int index) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return waiting_.at(index).points;
}

PointCloud WaitingClouds::Take(int index) {
  Waiting taken;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    taken = std::move(waiting_.at(index));
    waiting_.erase(index);
    bytes_ -= taken.cloud.size() * sizeof(SurfacePoint);
  }
  if (taken.cloud.size() == taken.points) return std::move(taken.cloud);
  std::optional<PointCloud> cloud = ReadPoints(FileOf(index));
  if (!cloud) throw ProcessingError(Concat("cannot read the ", taken.points, " points of ", FileOf(index).string()));
  std::error_code ignored;  // what is left goes with the work folder
  std::filesystem::remove(FileOf(index), ignored);
  return std::move(*cloud);
}

}  // namespace acmp
