#include <utility>

#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"
#include "acmp_mapping/planar_prior/kernel/support_grid.h"
#include "kernels.h"
#include "launch.h"

namespace acmp {
namespace {

constexpr int kTallBlock = 8;  ///< rows of a block, where a thread does little
constexpr int kWarp = 32;

/// The greatest of all threads' inverse depths. Floats that are not negative are in the order of their bits.
__global__ void LargestInverseKernel(ImageView<const float> depth, unsigned* largest) {
  const int col = static_cast<int>(blockIdx.x * kBlockWidth + threadIdx.x);
  const int row = static_cast<int>(blockIdx.y * kTallBlock + threadIdx.y);
  const float inverse = depth.Contains(col, row) ? InverseOfDepth(depth(col, row)) : 0.0f;
  const unsigned of_warp = WarpGroup<kWarp>::Greatest(__float_as_uint(inverse));
  __shared__ unsigned of_warps[kTallBlock];
  static_assert(kBlockWidth == kWarp, "a row of the block is a warp");
  if (threadIdx.x == 0) of_warps[threadIdx.y] = of_warp;
  __syncthreads();
  if (threadIdx.x != 0 || threadIdx.y != 0) return;
  unsigned of_block = 0;
  for (const unsigned value : of_warps) of_block = max(of_block, value);
  if (of_block > *static_cast<volatile unsigned*>(largest)) atomicMax(largest, of_block);
}

/// One warp per triangle, which fills its rows one after the other. Of those that share a pixel the last one has it.
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
        if (depth >= depth_min && depth <= depth_max) atomicMax(&numbers(col, row), static_cast<uint32_t>(index) + 1);
      }
    }
  }
}

}  // namespace

void LaunchToDepth(const ImageView<const PlaneHypothesis>& planes, const RayGrid& rays, const ImageView<float>& depth,
                   cudaStream_t stream) {
  const auto to_depth = [=] __device__(int col, int row) {
    const PlaneHypothesis plane = planes(col, row);
    const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
    depth(col, row) = plane.d > 0 ? PlaneDepth(plane, ray) : 0.0f;
  };
  LaunchForEach("launch depths", planes.width, planes.height, stream, to_depth, kTallBlock);
}

void LaunchHalveDepth(const ImageView<const float>& depth, float* largest, const ImageView<uint16_t>& inverse,
                      cudaStream_t stream) {
  CudaCheck(cudaMemsetAsync(largest, 0, sizeof(float), stream), "clear the largest inverse depth");
  const dim3 grid(DivideUp(depth.width, kBlockWidth), DivideUp(depth.height, kTallBlock));
  LargestInverseKernel<<<grid, dim3(kBlockWidth, kTallBlock), 0, stream>>>(depth, reinterpret_cast<unsigned*>(largest));
  CudaCheck(cudaGetLastError(), "launch search for the largest inverse depth");
  const auto halve = [=] __device__(int col, int row) {
    inverse(col, row) = StepsOfInverse(HalvedInverseDepth(depth, col, row), *largest / kInverseSteps);
  };
  LaunchForEach("launch halving of depths", inverse.width, inverse.height, stream, halve, kTallBlock);
}

void LaunchUpsample(const HalvedMaps& halved, const RayGrid& rays, const ImageView<PlaneHypothesis>& planes,
                    const ImageView<float>& cost, cudaStream_t stream) {
  const auto upsample = [=] __device__(int col, int row) {
    const int from_col = CoveringPixel(col, halved.level, halved.planes.width);
    const int from_row = CoveringPixel(row, halved.level, halved.planes.height);
    planes(col, row) = UpsamplePlane(halved.planes(from_col, from_row),
                                     halved.rays.Ray(static_cast<float>(from_col), static_cast<float>(from_row)),
                                     rays.Ray(static_cast<float>(col), static_cast<float>(row)));
    cost(col, row) = halved.cost(from_col, from_row);
  };
  LaunchForEach("launch upsampling", planes.width, planes.height, stream, upsample, kTallBlock);
}

void LaunchFindSupport(const SupportSearch& search, const ImageView<SupportPoint>& cells, cudaStream_t stream) {
  const auto find = [=] __device__(int col, int row) {
    cells(col, row) = FindSupportPointOfCell(search.depth, search.cost, search.depth_min, search.depth_max,
                                             search.max_cost, search.cell_size, col, row);
  };
  LaunchForEach("launch support points", cells.width, cells.height, stream, find, kTallBlock);
}

void LaunchRasterizePrior(const PriorTriangles& triangles, const RayGrid& rays, float depth_min, float depth_max,
                          const ImageView<uint32_t>& numbers, cudaStream_t stream) {
  const size_t bytes = static_cast<size_t>(numbers.width) * numbers.height * sizeof(uint32_t);
  CudaCheck(cudaMemsetAsync(numbers.data, 0, bytes, stream), "clear the prior");
  if (triangles.count == 0) return;
  constexpr int kWarpsPerBlock = 8;
  RasterizePriorKernel<<<DivideUp(triangles.count, kWarpsPerBlock), kWarpsPerBlock * kWarp, 0, stream>>>(
      triangles, rays, depth_min, depth_max, numbers);
  CudaCheck(cudaGetLastError(), "launch planar prior");
}

void LaunchGridPrior(const SupportGrid& first, const RayGrid& rays, float min_cosine, const DepthRange& range,
                     const ImageView<uint32_t>& numbers, cudaStream_t stream) {
  SupportGrid grid = first;
  const int cols = grid.points.width, rows = grid.points.height;
  for (int step = FirstFloodingStep(cols, rows); step > 0; step /= 2) {
    LaunchForEach("launch flooding of support points", cols, rows, stream, [=] __device__(int col, int row) {
      grid.flooded(col, row) = FloodCell(grid.points, grid.cell_size, step, col, row);
    });
    std::swap(grid.points, grid.flooded);
  }
  LaunchForEach("launch triangles of the prior", cols, rows, stream,
                [=] __device__(int col, int row) { SetTrianglesOfGroup(grid, rays, min_cosine, col, row); });
  LaunchRasterizePrior({grid.triangles, grid.planes, 2 * cols * rows}, rays, range.min, range.max, numbers, stream);
}

void LaunchFillLayer(cudaTextureObject_t source, int source_layer, float scale, cudaSurfaceObject_t destination,
                     const LayerImage& image, int layer_width, int layer_height, cudaStream_t stream) {
  // With scale 2 the position is the corner that four pixels share: the filter gives their mean.
  const auto fill = [=] __device__(int col, int row) {
    const float x = scale * (static_cast<float>(min(col, image.width - 1)) + 0.5f);
    const float y = scale * (static_cast<float>(min(row, image.height - 1)) + 0.5f);
    const float value = tex2DLayered<float>(source, x, y, source_layer);
    const auto texel = static_cast<unsigned short>(__float2uint_rn(65535.0f * __saturatef(value)));
    surf2DLayeredwrite(texel, destination, col * static_cast<int>(sizeof(texel)), row, image.layer);
  };
  LaunchForEach("launch texture fill", layer_width, layer_height, stream, fill, kTallBlock);
}

}  // namespace acmp
