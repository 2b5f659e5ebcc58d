#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/planar_prior/kernel/planar_prior.h"

namespace acmp {

/// All queue work on a stream; pointers and views are device memory.

/// z of every pixel's plane; 0 where there is none.
void LaunchToDepth(const ImageView<const PlaneHypothesis>& planes, const RayGrid& rays, float* depth,
                   cudaStream_t stream);

/// HalvedDepth of a depth map.
/// @param largest a float; becomes the greatest inverse depth, 1 / scene unit, 0 where no depth is known
/// @param inverse of HalvedSize in both directions
void LaunchHalveDepth(const ImageView<const float>& depth, float* largest, const ImageView<uint16_t>& inverse,
                      cudaStream_t stream);

/// Plane (UpsamplePlane) and cost of every pixel from the pixel that covers it in maps halved `level` times.
struct HalvedMaps {
  ImageView<const PlaneHypothesis> planes;
  const float* cost;
  RayGrid rays;
  int level;
};
void LaunchUpsample(const HalvedMaps& halved, const RayGrid& rays, const ImageView<PlaneHypothesis>& planes,
                    float* cost, cudaStream_t stream);

/// Credible pixels per cell of `cell_size` px squared; rows of ceil(width / cell_size) cells.
struct SupportSearch {
  ImageView<const float> depth, cost;
  float depth_min, depth_max, max_cost;
  int cell_size;
};
void LaunchFindSupport(const SupportSearch& search, SupportPoint* cells, cudaStream_t stream);

/// The triangles of the prior as the GPU draws them.
struct PriorTriangles {
  const TriangleCorners* corners;
  const PlaneHypothesis* planes;  ///< zero: none
  int count;
};

/// Draws the triangles' numbers, from 1, where their planes lie within [depth_min, depth_max]; the other pixels become
/// zero.
void LaunchRasterizePrior(const PriorTriangles& triangles, const RayGrid& rays, float depth_min, float depth_max,
                          const ImageView<uint32_t>& numbers, cudaStream_t stream);

/// A layer of a texture or surface with the size of the image in it, px.
struct LayerImage {
  int layer, width, height;
};

/// Queues the filling of a whole layer, `layer_width` x `layer_height` px of 16 bits, from a layer of a texture:
/// `scale` = 1 copies, 2 takes the means of 2 x 2 pixels. Beyond the image its last column and row go on.
void LaunchFillLayer(cudaTextureObject_t source, int source_layer, float scale, cudaSurfaceObject_t destination,
                     const LayerImage& image, int layer_width, int layer_height, cudaStream_t stream);

}  // namespace acmp
