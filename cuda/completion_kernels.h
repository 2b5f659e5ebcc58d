#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/completion/kernel/completion_grid.h"
#include "acmp_mapping/completion/kernel/weighted_median.h"
#include "fusion_kernels.h"

namespace acmp {

/// Queues LookAtPixel for all pixels, the first step of CompleteUnconfirmed. All pointers are device memory, as below.
/// Throws InvalidInputError for more than kMaxCudaFusionSources sources.
/// @param sources compares the reference's maps as they were before
/// @param sightings of the reference's size
void LaunchLook(const DeviceFusionContext& sources, const ImageView<Sightings>& sightings, cudaStream_t stream);

/// Queues the rest of CompleteUnconfirmed.
void LaunchCompletion(const CompletionContext& context, cudaStream_t stream);

/// Queues the weighted median of the completed maps.
/// @param views compares the completed reference
/// @param sightings the same as the context's: of the reference before it was completed
void LaunchWeightedMedian(const DeviceFusionContext& views, const ImageView<Sightings>& sightings,
                          const MedianContext& context, cudaStream_t stream);

/// Queues RefuteUnsupported.
/// @param context from MakeEvidentContext, with places for its anchors
void LaunchRefutation(const CompletionContext& context, const ImageView<const float>& evidence, cudaStream_t stream);

}  // namespace acmp
