#pragma once

#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

/// FilterByConsistency and FuseDepthMaps on GPU `cuda_index`, for at most 32 source views each; in CUDA builds only.
/// The same to rounding: only fused multiply-adds and the last bits of exp, asin and atan2 differ. All views are
/// uploaded at once (29 bytes per pixel) and nothing is kept. Throw also InvalidInputError that says what is missing
/// (driver, device, code for the device's architecture) and ProcessingError when the device fails.
ConsistencyResult FilterByConsistencyCuda(const FusionView& reference, const std::vector<FusionView>& sources,
                                          const FusionOptions& options, int cuda_index = 0);
PointCloud FuseDepthMapsCuda(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                             const FusionOptions& options, int cuda_index = 0);

}  // namespace acmp
