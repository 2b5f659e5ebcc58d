#include "cuda_prior.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>

#include "acmp_mapping/patch_match/match_setup.h"

namespace acmp {

std::vector<SupportPoint> CudaPrior::FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                                       const PlanarPriorOptions& options) {
  Validate(options);
  CheckDepthRange("depth range of the support points", range);
  const CudaEstimate& maps = queue_.Cast<CudaEstimate>(estimate);
  return queue_.OnDevice([&] { return FindCells(maps, range, options); });
}

std::vector<SupportPoint> CudaPrior::FindCells(const CudaEstimate& maps, const DepthRange& range,
                                               const PlanarPriorOptions& options) {
  const CudaStream& stream = queue_.stream();
  const int size = options.cell_size_px;
  const size_t count =
      static_cast<size_t>((maps.width + size - 1) / size) * static_cast<size_t>((maps.height + size - 1) / size);
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
}

void CudaPrior::Upload(const PriorMesh& mesh) {
  const size_t count = mesh.triangles.size();
  num_triangles_ = static_cast<int>(count);
  triangles_.Reserve(queue_.device(), count);
  planes_.Reserve(queue_.device(), count);
  if (count == 0) return;
  auto* planes =
      queue_.staging()->Reserve<PlaneHypothesis>(count + count * sizeof(TriangleCorners) / sizeof(PlaneHypothesis) + 1);
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

PriorMap CudaPrior::MapIn(CudaEstimate* estimate) const {
  return {{planes_.data(), num_triangles_, 1, num_triangles_}, estimate->NumbersView()};
}

void CudaPrior::QueueDrawing(const PatchMatchProblem& match, const ImageView<uint32_t>& numbers) const {
  LaunchRasterizePrior({triangles_.data(), planes_.data(), num_triangles_}, MakeRayGrid(match.reference.camera),
                       match.depth_range.min, match.depth_range.max, numbers, queue_.stream().get());
}

}  // namespace acmp
