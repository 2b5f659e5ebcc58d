#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_estimate.h"
#include "map_kernels.h"

namespace acmp {

/// Steps 10 to 13 on the GPU but for the triangulation: support points, and the prior as a pass reads it.
class CudaPrior : public virtual DepthEngine {
 public:
  /// @param queue outlives this
  explicit CudaPrior(DeviceQueue* queue) : queue_(*queue) {}

  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override {
    Validate(options);
    CheckDepthRange("depth range of the support points", range);
    const CudaEstimate& maps = queue_.Cast<CudaEstimate>(estimate);
    return queue_.OnDevice([&] {
      const CudaStream& stream = queue_.stream();
      const int size = options.cell_size_px;
      const size_t count = static_cast<size_t>(CellsOf(maps.width, size)) * CellsOf(maps.height, size);
      cells_.Reserve(queue_.device(), count);
      LaunchFindSupport({maps.DepthView(), maps.CostView(), range.min, range.max, options.max_support_cost, size},
                        cells_.data(), stream.get());
      SupportPoint* staged = queue_.staging()->Reserve<SupportPoint>(count);
      cells_.Download(staged, count, stream);
      stream.Synchronize();
      std::vector<SupportPoint> points;
      points.reserve(count);
      std::copy_if(staged, staged + count, std::back_inserter(points),
                   [](const SupportPoint& point) { return point.depth > 0; });
      return points;
    });
  }

  /// Queues the upload of the triangles.
  void Upload(const PriorMesh& mesh) {
    const size_t count = mesh.triangles.size();
    num_triangles_ = static_cast<int>(count);
    triangles_.Reserve(queue_.device(), count);
    planes_.Reserve(queue_.device(), count);
    if (count == 0) return;
    auto* planes = queue_.staging()->Reserve<PlaneHypothesis>(
        count + count * sizeof(TriangleCorners) / sizeof(PlaneHypothesis) + 1);
    auto* corners = reinterpret_cast<TriangleCorners*>(planes + count);
    tbb::parallel_for(size_t{0}, count, [&](size_t i) {
      planes[i] = mesh.planes[i];
      for (int k = 0; k < 3; ++k) {
        const SupportPoint& point = mesh.points[static_cast<size_t>(mesh.triangles[i].vertex[k])];
        corners[i].col[k] = point.col;
        corners[i].row[k] = point.row;
      }
    });
    planes_.Upload(planes, count, queue_.stream());
    triangles_.Upload(corners, count, queue_.stream());
  }
  /// What was uploaded as a pass over an estimate reads it, once it is drawn: the pixels' numbers take the place of the
  /// estimate's depths, which are set after the pass.
  PriorMap MapIn(CudaEstimate* estimate) const {
    return {{planes_.data(), num_triangles_, 1, num_triangles_}, estimate->NumbersView()};
  }
  /// Queues the drawing of the triangles' numbers.
  void QueueDrawing(const PatchMatchProblem& match, const ImageView<uint32_t>& numbers) const {
    LaunchRasterizePrior({triangles_.data(), planes_.data(), num_triangles_}, MakeRayGrid(match.reference.camera),
                         match.depth_range.min, match.depth_range.max, numbers, queue_.stream().get());
  }

 private:
  DeviceQueue& queue_;
  int num_triangles_ = 0;
  DeviceArray<PlaneHypothesis> planes_;  ///< of the triangles
  DeviceArray<TriangleCorners> triangles_;
  DeviceArray<SupportPoint> cells_;
};

}  // namespace acmp
