#pragma once

#include <cuda_runtime_api.h>

namespace acmp {

/// A layer of a texture or surface with the size of the image in it, px.
struct LayerImage {
  int layer, width, height;
};

/// Queues the filling of a whole layer, `layer_width` x `layer_height` px of 16 bits, from a layer of a texture:
/// `scale` = 1 copies, 2 takes the means of 2 x 2 pixels. Beyond the image its last column and row go on.
void LaunchFillLayer(cudaTextureObject_t source, int source_layer, float scale, cudaSurfaceObject_t destination,
                     const LayerImage& image, int layer_width, int layer_height, cudaStream_t stream);

}  // namespace acmp
