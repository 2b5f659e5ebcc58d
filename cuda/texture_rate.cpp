#include "texture_rate.h"

#include <utility>
#include <vector>

#include "acmp_mapping/backend/texture_rate.h"
#include "acmp_mapping/common/median.h"
#include "cuda_device.h"

namespace acmp {

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
