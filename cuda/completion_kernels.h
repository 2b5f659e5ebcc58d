#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/completion/kernel/completion_grid.h"
#include "fusion_kernels.h"

namespace acmp {

/// Queues CompleteUnconfirmed. All pointers are device memory. Throws InvalidInputError for more than
/// kMaxCudaFusionSources sources.
/// @param sources compares the reference's maps as they were before
/// @param confirming of the reference's size; the same as the context's
void LaunchCompletion(const DeviceFusionContext& sources, const ImageView<unsigned char>& confirming,
                      const CompletionContext& context, cudaStream_t stream);

}  // namespace acmp
