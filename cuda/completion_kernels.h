#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/completion/kernel/completion_grid.h"
#include "acmp_mapping/completion/kernel/weighted_median.h"
#include "fusion_kernels.h"

namespace acmp {

/// Queues CompleteUnconfirmed. All pointers are device memory. Throws InvalidInputError for more than
/// kMaxCudaFusionSources sources.
/// @param sources compares the reference's maps as they were before
/// @param sightings of the reference's size; the same as the context's
void LaunchCompletion(const DeviceFusionContext& sources, const ImageView<Sightings>& sightings,
                      const CompletionContext& context, cudaStream_t stream);

/// Queues the weighted median of the completed maps.
/// @param views compares the completed reference
/// @param sightings the same as the context's: of the reference before it was completed
void LaunchWeightedMedian(const DeviceFusionContext& views, const ImageView<Sightings>& sightings,
                          const MedianContext& context, cudaStream_t stream);

/// Queues RefuteUnsupported. All pointers are device memory.
/// @param context from MakeRefutationContext, with places for its anchors
void LaunchRefutation(const CompletionContext& context, const ImageView<const float>& evidence, cudaStream_t stream);

}  // namespace acmp
