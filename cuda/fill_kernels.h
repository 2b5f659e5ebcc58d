#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/fill/kernel/fill_grid.h"
#include "acmp_mapping/fill/kernel/weighted_median.h"
#include "fusion_kernels.h"

namespace acmp {

/// Queues CountSupportingViews for all pixels, the first step of FillUnverified. All pointers are device memory, as
/// below.
/// @param sources compares the reference's maps as they were before
/// @param view support of the reference's size
void LaunchLook(const FusionContext& sources, const ImageView<ViewSupport>& support, cudaStream_t stream);

/// Queues the rest of FillUnverified.
void LaunchFill(const FillContext& context, cudaStream_t stream);

/// Queues the weighted median of the completed maps.
/// @param views compares the completed reference
/// @param view support the same as the context's: of the reference before it was completed
void LaunchWeightedMedian(const FusionContext& views, const ImageView<ViewSupport>& support,
                          const MedianContext& context, cudaStream_t stream);

/// Queues RemoveUnsupported.
/// @param context from MakeTexturedContext, with places for its seeds
void LaunchFreeSpaceCheck(const FillContext& context, const ImageView<const float>& evidence, cudaStream_t stream);

}  // namespace acmp
