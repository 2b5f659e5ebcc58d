#pragma once

#include <cuda_runtime_api.h>

namespace acmp {

/// Queues `fetches` bilinear fetches from a layer for each of width x height threads (a multiple of 256). `sums`: one
/// float each.
void LaunchFetches(cudaTextureObject_t texture, int layer, int width, int height, int fetches, float* sums,
                   cudaStream_t stream);

}  // namespace acmp
