#pragma once

#include <vector>

#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/planar_prior/planar_prior.h"
#include "cuda_estimate.h"
#include "map_kernels.h"

namespace acmp {

/// Steps 10 to 13 on the GPU but for the triangulation: support points, and the prior as a pass reads it.
class CudaPrior : public virtual MatchingEngine {
 public:
  /// @param queue outlives this
  explicit CudaPrior(DeviceQueue* queue) : queue_(*queue) {}

  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override;

  /// Queues the upload of the triangles.
  void Upload(const PriorMesh& mesh);
  /// What was uploaded as a pass over an estimate reads it, once it is drawn: the pixels' numbers take the place of the
  /// estimate's depths, which are set after the pass.
  PriorMap MapIn(CudaEstimate* estimate) const;
  /// Queues the drawing of the triangles' numbers.
  void QueueDrawing(const PatchMatchProblem& match, const ImageView<uint32_t>& numbers) const;

 private:
  std::vector<SupportPoint> FindCells(const CudaEstimate& maps, const DepthRange& range,
                                      const PlanarPriorOptions& options);

  DeviceQueue& queue_;
  int num_triangles_ = 0;
  DeviceArray<PlaneHypothesis> planes_;  ///< of the triangles
  DeviceArray<TriangleCorners> triangles_;
  DeviceArray<SupportPoint> cells_;
};

}  // namespace acmp
