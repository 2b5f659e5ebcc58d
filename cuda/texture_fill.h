#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Queues the conversion of a grey image (0..255, device memory) to a layer of 16-bit texels, `width` x `height` px;
/// beyond the image its last column and row go on.
void LaunchFillLayer(const ImageView<const float>& image, cudaSurfaceObject_t surface, int width, int height, int layer,
                     cudaStream_t stream);

}  // namespace acmp
