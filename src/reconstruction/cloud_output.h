#pragma once

#include <memory>
#include <optional>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "output_folder.h"
#include "tiled_cloud.h"

namespace acmp {

/// How much a run's cloud is.
struct CloudSize {
  size_t points = 0;
  std::optional<size_t> tiles;  ///< nothing: one file
};

/// Where a run's cloud goes: OUTPUT/fused.ply, or with --tile-size OUTPUT/tiles. Errors are those of PlyFile and
/// TiledCloud.
class CloudOutput {
 public:
  /// @param folder outlives this
  /// @param origin of the points' coordinates, which is added (WritePly)
  CloudOutput(const ReconstructOptions& options, const OutputFolder* folder, const Eigen::Vector3d& origin);

  /// Whether places must be filled in their order, by one thread at a time; else by any threads at once.
  bool in_order() const { return tiles_ != nullptr; }
  /// Sets aside the places of so many points, after those of earlier calls. Returns the number of the first point. By
  /// one thread at a time.
  size_t Reserve(size_t points);
  /// Fills places that were set aside. @param first number of the first point
  void WriteAt(size_t first, const PointCloud& points);
  /// Once all places are filled. Without it there is no cloud.
  void Commit(const StopRequest& interrupt);

  CloudSize size() const;

 private:
  std::unique_ptr<PlyFile> file_;      ///< this one
  std::unique_ptr<TiledCloud> tiles_;  ///< or that one
};

}  // namespace acmp
