#include "map_kernels.h"

#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"
#include "cuda_resources.h"
#include "warp_group.h"

namespace acmp {
namespace {

constexpr int kBlockWidth = 32;
constexpr int kBlockHeight = 8;
constexpr int kWarp = 32;

dim3 GridFor(int width, int height) {
  return dim3((width + kBlockWidth - 1) / kBlockWidth, (height + kBlockHeight - 1) / kBlockHeight);
}

__device__ int Col() { return static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x); }
__device__ int Row() { return static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y); }

__global__ void ToDepthKernel(ImageView<const PlaneHypothesis> planes, RayGrid rays, float* depth) {
  const int col = Col(), row = Row();
  if (col >= planes.width || row >= planes.height) return;
  const PlaneHypothesis plane = planes(col, row);
  const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
  depth[static_cast<size_t>(row) * planes.width + col] = plane.d > 0 ? PlaneDepth(plane, ray) : 0.0f;
}

/// The greatest of all threads' inverse depths. Floats that are not negative are in the order of their bits.
__global__ void LargestInverseKernel(ImageView<const float> depth, unsigned* largest) {
  const int col = Col(), row = Row();
  const float inverse = depth.Contains(col, row) ? InverseOfDepth(depth(col, row)) : 0.0f;
  const unsigned of_warp = WarpGroup<kWarp>::Greatest(__float_as_uint(inverse));
  __shared__ unsigned of_warps[kBlockHeight];
  static_assert(kBlockWidth == kWarp, "a row of the block is a warp");
  if (threadIdx.x == 0) of_warps[threadIdx.y] = of_warp;
  __syncthreads();
  if (threadIdx.x != 0 || threadIdx.y != 0) return;
  unsigned of_block = 0;
  for (const unsigned value : of_warps) of_block = max(of_block, value);
  if (of_block > *static_cast<volatile unsigned*>(largest)) atomicMax(largest, of_block);
}

__global__ void HalveDepthKernel(ImageView<const float> depth, const float* largest, ImageView<uint16_t> inverse) {
  const int col = Col(), row = Row();
  if (!inverse.Contains(col, row)) return;
  inverse(col, row) = StepsOfInverse(HalvedInverseDepth(depth, col, row), *largest / kInverseSteps);
}

__global__ void UpsampleKernel(HalvedMaps halved, RayGrid rays, ImageView<PlaneHypothesis> planes, float* cost) {
  const int col = Col(), row = Row();
  if (col >= planes.width || row >= planes.height) return;
  const int from_col = CoveringPixel(col, halved.level, halved.planes.width);
  const int from_row = CoveringPixel(row, halved.level, halved.planes.height);
  planes(col, row) = UpsamplePlane(halved.planes(from_col, from_row),
                                   halved.rays.Ray(static_cast<float>(from_col), static_cast<float>(from_row)),
                                   rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  cost[static_cast<size_t>(row) * planes.width + col] =
      halved.cost[static_cast<size_t>(from_row) * halved.planes.width + from_col];
}

__global__ void FindSupportKernel(SupportSearch search, int cell_cols, int cell_rows, SupportPoint* cells) {
  const int col = Col(), row = Row();
  if (col >= cell_cols || row >= cell_rows) return;
  cells[static_cast<size_t>(row) * cell_cols + col] = FindSupportPointOfCell(
      search.depth, search.cost, search.depth_min, search.depth_max, search.max_cost, search.cell_size, col, row);
}

/// One warp per triangle, which fills its rows one after the other. No two triangles share a pixel.
__global__ void RasterizePriorKernel(PriorTriangles triangles, RayGrid rays, float depth_min, float depth_max,
                                     ImageView<uint32_t> numbers) {
  const int index = static_cast<int>((blockIdx.x * blockDim.x + threadIdx.x) / kWarp);
  if (index >= triangles.count) return;
  const PlaneHypothesis plane = triangles.planes[index];
  if (!(plane.d > 0)) return;
  const RasterTriangle triangle = MakeRasterTriangle(triangles.corners[index]);
  const int thread = static_cast<int>(threadIdx.x) % kWarp;
  const int row_end = min(triangle.row_max + 1, numbers.height);
  // Spans take divisions of 64 bits: each thread finds that of one row, and all fill them one after the other.
  for (int first_row = max(triangle.row_min, 0); first_row < row_end; first_row += kWarp) {
    ColumnSpan own = {0, -1};
    if (first_row + thread < row_end) own = SpanOfRow(triangle, first_row + thread, numbers.width);
    const int rows = min(kWarp, row_end - first_row);
    for (int i = 0; i < rows; ++i) {
      const ColumnSpan span = {WarpGroup<kWarp>::From(i, own.first), WarpGroup<kWarp>::From(i, own.last)};
      const int row = first_row + i;
      for (int col = span.first + thread; col <= span.last; col += kWarp) {
        const float depth = PlaneDepth(plane, rays.Ray(static_cast<float>(col), static_cast<float>(row)));
        if (depth >= depth_min && depth <= depth_max) numbers(col, row) = static_cast<uint32_t>(index) + 1;
      }
    }
  }
}

/// With scale 2 the position is the corner that four pixels share: the filter gives their mean.
__global__ void FillLayerKernel(cudaTextureObject_t source, int source_layer, float scale,
                                cudaSurfaceObject_t destination, LayerImage image, int layer_width, int layer_height) {
  const int col = static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x);
  const int row = static_cast<int>(blockIdx.y * kBlockHeight + threadIdx.y);
  if (col >= layer_width || row >= layer_height) return;
  const float x = scale * (static_cast<float>(min(col, image.width - 1)) + 0.5f);
  const float y = scale * (static_cast<float>(min(row, image.height - 1)) + 0.5f);
  const float value = tex2DLayered<float>(source, x, y, source_layer);
  const auto texel = static_cast<unsigned short>(__float2uint_rn(65535.0f * __saturatef(value)));
  surf2DLayeredwrite(texel, destination, col * static_cast<int>(sizeof(texel)), row, image.layer);
}

}  // namespace

void LaunchToDepth(const ImageView<const PlaneHypothesis>& planes, const RayGrid& rays, float* depth,
                   cudaStream_t stream) {
  ToDepthKernel<<<GridFor(planes.width, planes.height), dim3(kBlockWidth, kBlockHeight), 0, stream>>>(planes, rays,
                                                                                                      depth);
  CudaCheck(cudaGetLastError(), "launch depths");
}

void LaunchHalveDepth(const ImageView<const float>& depth, float* largest, const ImageView<uint16_t>& inverse,
                      cudaStream_t stream) {
  CudaCheck(cudaMemsetAsync(largest, 0, sizeof(float), stream), "clear the largest inverse depth");
  const dim3 block(kBlockWidth, kBlockHeight);
  LargestInverseKernel<<<GridFor(depth.width, depth.height), block, 0, stream>>>(depth,
                                                                                 reinterpret_cast<unsigned*>(largest));
  CudaCheck(cudaGetLastError(), "launch search for the largest inverse depth");
  HalveDepthKernel<<<GridFor(inverse.width, inverse.height), block, 0, stream>>>(depth, largest, inverse);
  CudaCheck(cudaGetLastError(), "launch halving of depths");
}

void LaunchUpsample(const HalvedMaps& halved, const RayGrid& rays, const ImageView<PlaneHypothesis>& planes,
                    float* cost, cudaStream_t stream) {
  UpsampleKernel<<<GridFor(planes.width, planes.height), dim3(kBlockWidth, kBlockHeight), 0, stream>>>(halved, rays,
                                                                                                       planes, cost);
  CudaCheck(cudaGetLastError(), "launch upsampling");
}

void LaunchFindSupport(const SupportSearch& search, SupportPoint* cells, cudaStream_t stream) {
  const int cols = (search.depth.width + search.cell_size - 1) / search.cell_size;
  const int rows = (search.depth.height + search.cell_size - 1) / search.cell_size;
  FindSupportKernel<<<GridFor(cols, rows), dim3(kBlockWidth, kBlockHeight), 0, stream>>>(search, cols, rows, cells);
  CudaCheck(cudaGetLastError(), "launch support points");
}

void LaunchRasterizePrior(const PriorTriangles& triangles, const RayGrid& rays, float depth_min, float depth_max,
                          const ImageView<uint32_t>& numbers, cudaStream_t stream) {
  const size_t bytes = static_cast<size_t>(numbers.width) * numbers.height * sizeof(uint32_t);
  CudaCheck(cudaMemsetAsync(numbers.data, 0, bytes, stream), "clear the prior");
  if (triangles.count == 0) return;
  constexpr int kWarpsPerBlock = 8;
  const int blocks = (triangles.count + kWarpsPerBlock - 1) / kWarpsPerBlock;
  RasterizePriorKernel<<<blocks, kWarpsPerBlock * kWarp, 0, stream>>>(triangles, rays, depth_min, depth_max, numbers);
  CudaCheck(cudaGetLastError(), "launch planar prior");
}

void LaunchFillLayer(cudaTextureObject_t source, int source_layer, float scale, cudaSurfaceObject_t destination,
                     const LayerImage& image, int layer_width, int layer_height, cudaStream_t stream) {
  const dim3 block(kBlockWidth, kBlockHeight);
  const dim3 grid((layer_width + kBlockWidth - 1) / kBlockWidth, (layer_height + kBlockHeight - 1) / kBlockHeight);
  FillLayerKernel<<<grid, block, 0, stream>>>(source, source_layer, scale, destination, image, layer_width,
                                              layer_height);
  CudaCheck(cudaGetLastError(), "launch texture fill");
}

}  // namespace acmp
