#include "cloud_output.h"

namespace acmp {

CloudOutput::CloudOutput(const ReconstructOptions& options, const OutputFolder* folder, const Eigen::Vector3d& origin) {
  if (options.tile_size) {
    tiles_ = std::make_unique<TiledCloud>(folder, *options.tile_size, options.CloudBytes(), origin);
  } else {
    file_ = std::make_unique<PlyFile>(folder->path() / "fused.ply", Durability::kPowerCut, origin);
  }
}

size_t CloudOutput::Reserve(size_t points) { return file_ ? file_->Reserve(points) : tiles_->points(); }

void CloudOutput::WriteAt(size_t first, const PointCloud& points) {
  if (file_) return file_->WriteAt(first, points);
  tiles_->Add(points);
}

void CloudOutput::Commit(const StopRequest& interrupt) {
  if (file_) return file_->Commit();
  tiles_->Commit(interrupt);
}

CloudSize CloudOutput::size() const {
  if (file_) return {file_->points(), std::nullopt};
  return {tiles_->points(), tiles_->tiles()};
}

}  // namespace acmp
