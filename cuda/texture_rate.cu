#include <utility>
#include <vector>

#include "acmp_mapping/backend/texture_rate.h"
#include "acmp_mapping/common/median.h"
#include "cuda_device.h"

namespace acmp {

namespace {

/// Each thread fetches along a slanted line near its own pixel, as a warped window does: neighbouring threads share
/// cache lines, so the filter units and not memory are the limit. The sum is written so that nothing is optimised away.
__global__ void FetchKernel(cudaTextureObject_t texture, int layer, int width, int fetches, float* sums) {
  const int index = blockIdx.x * blockDim.x + threadIdx.x;
  float x = static_cast<float>(index % width) + 0.3f;
  float y = static_cast<float>(index / width) + 0.6f;
  float sum = 0;
#pragma unroll 8
  for (int i = 0; i < fetches; ++i) {
    sum += tex2DLayered<float>(texture, x, y, layer);
    x += 0.37f;
    y += 0.11f;
  }
  sums[index] = sum;
}

/// Queues `fetches` bilinear fetches from a layer for each of width x height threads (a multiple of 256). `sums`: one
/// float each.
void LaunchFetches(cudaTextureObject_t texture, int layer, int width, int height, int fetches, float* sums,
                   cudaStream_t stream) {
  constexpr int kBlock = 256;
  FetchKernel<<<width * height / kBlock, kBlock, 0, stream>>>(texture, layer, width, fetches, sums);
  CudaCheck(cudaGetLastError(), "launch texture fetches");
}

}  // namespace

double MeasureTextureRate(int cuda_index, int multiprocessors) {
  constexpr int kSize = 2048, kFetches = 512, kRepetitions = 7;
  const auto device = std::make_shared<CudaDevice>(cuda_index, multiprocessors);
  const CudaStream stream(device->share());
  const CudaEvent begin, end;
  GrayImage image(kSize, kSize);
  for (size_t i = 0; i < image.size(); ++i) image.data()[i] = static_cast<float>(i * 2654435761u >> 24 & 255u);
  PinnedBuffer staging;
  TexturePool& images = device->images(0);
  const int layer = images.Acquire(kSize, kSize, stream, &device->images_mutex());
  images.Upload(std::as_const(image).View(), layer, &staging, stream);
  const DeviceArray<float> sums(device, image.size());

  std::vector<double> milliseconds(kRepetitions);
  LaunchFetches(images.texture(), layer, kSize, kSize, kFetches, sums.data(), stream.get());  // warm-up
  for (double& ms : milliseconds) {
    begin.Record(stream);
    LaunchFetches(images.texture(), layer, kSize, kSize, kFetches, sums.data(), stream.get());
    end.Record(stream);
    stream.Synchronize();
    ms = CudaEvent::ElapsedMs(begin, end);
  }
  return static_cast<double>(kSize) * kSize * kFetches / (Median(std::move(milliseconds)) * 1e-3);
}

}  // namespace acmp
