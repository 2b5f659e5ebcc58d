#pragma once

#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

/// The functions without "Cuda" on GPU `cuda_index`, from and to host memory. At most 32 sources per view.
ConsistencyResult FilterByConsistencyCuda(const FusionView& reference, const std::vector<FusionView>& sources,
                                          const FusionOptions& options, int cuda_index = 0);
/// Its confidences alone.
ConfidenceMap MeasureConfidenceCuda(const FusionView& reference, const std::vector<FusionView>& sources,
                                    const FusionOptions& options);
PointCloud FuseDepthMapsCuda(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                             const FusionOptions& options, int cuda_index = 0);

}  // namespace acmp
