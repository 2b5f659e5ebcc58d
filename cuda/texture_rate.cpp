#include "texture_rate.h"

#include <algorithm>
#include <array>

#include "acmp_mapping/backend/texture_rate.h"
#include "cuda_resources.h"

namespace acmp {

double MeasureTextureRate(int cuda_index) {
  constexpr int kSize = 2048, kFetches = 512, kRepetitions = 7;
  CudaCheck(cudaSetDevice(cuda_index), "select device");
  const CudaStream stream;
  const CudaEvent begin, end;
  GrayImage image(kSize, kSize);
  for (size_t i = 0; i < image.size(); ++i) image.data()[i] = static_cast<float>(i * 2654435761u >> 24 & 255u);
  DeviceTexture texture;
  texture.Upload({image.View()}, stream);
  DeviceBuffer<float> sums;
  sums.Resize(image.size());

  std::array<double, kRepetitions> milliseconds;
  LaunchFetches(texture.get(), kSize, kSize, kFetches, sums.data(), stream.get());  // warm-up
  for (double& ms : milliseconds) {
    begin.Record(stream);
    LaunchFetches(texture.get(), kSize, kSize, kFetches, sums.data(), stream.get());
    end.Record(stream);
    stream.Synchronize();
    ms = CudaEvent::ElapsedMs(begin, end);
  }
  std::nth_element(milliseconds.begin(), milliseconds.begin() + kRepetitions / 2, milliseconds.end());
  return static_cast<double>(kSize) * kSize * kFetches / (milliseconds[kRepetitions / 2] * 1e-3);
}

}  // namespace acmp
