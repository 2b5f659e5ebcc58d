#pragma once

#include <map>
#include <memory>
#include <mutex>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "output_folder.h"
#include "run.h"
#include "tiled_cloud.h"

namespace acmp {

/// Where a run's cloud goes: OUTPUT/fused.ply, or with --tile-size OUTPUT/tiles. Errors are those of PlyFile and
/// TiledCloud.
class CloudOutput {
 public:
  /// @param run with a folder; outlives this
  explicit CloudOutput(const ReconstructRun& run);

  /// Whether places must be filled in their order, by one thread at a time; else by any threads at once.
  bool in_order() const { return tiles_ != nullptr; }
  /// Sets aside the places of so many points, after those of earlier calls. Returns the number of the first point. By
  /// one thread at a time.
  size_t Reserve(size_t points) { return file_ ? file_->Reserve(points) : tiles_->points(); }
  /// Fills places that were set aside. @param first number of the first point
  void WriteAt(size_t first, const PointCloud& points);
  /// Once all places are filled. Without it there is no cloud.
  void Commit();

  CloudSize size() const;

 private:
  const StopRequest& interrupt_;
  std::unique_ptr<PlyFile> file_;      ///< this one
  std::unique_ptr<TiledCloud> tiles_;  ///< or that one
};

/// Points of views that are fused and wait for their place in the cloud, which is known when all earlier views are
/// fused. In memory up to a number of bytes, beyond in files of the work folder, so that a scene of any size can be
/// fused (but COLMAP's model keeps all points). For any number of threads.
class WaitingClouds {
 public:
  /// @param folder outlives this
  WaitingClouds(const OutputFolder* folder, size_t max_bytes) : folder_(*folder), max_bytes_(max_bytes) {}

  /// Keeps a view's points; once per view. Throws ProcessingError when their file cannot be written.
  void Put(int index, PointCloud cloud);
  /// How many they are, until they are handed out.
  size_t NumPoints(int index) const;
  /// Hands them out, once. Throws ProcessingError when their file cannot be read.
  PointCloud Take(int index);

 private:
  std::filesystem::path FileOf(int index) const { return folder_.WorkFile("points", index); }

  const OutputFolder& folder_;
  const size_t max_bytes_;

  mutable std::mutex mutex_;  ///< of what follows
  struct Waiting {
    size_t points = 0;
    PointCloud cloud;  ///< empty: in the view's file
  };
  std::map<int, Waiting> waiting_;
  size_t bytes_ = 0;  ///< in memory
};

}  // namespace acmp
