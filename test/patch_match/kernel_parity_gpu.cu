#include <memory>

#include "acmp_mapping/patch_match/kernel/window.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_device.h"
#include "kernel_parity_answer.h"
#include "kernels.h"

namespace acmp {
namespace {

__global__ void AnswerKernel(const MatchContext<BilinearSampler> bilinear,
                             const MatchContext<AbsoluteDifferenceSampler> other, const CudaMatchContext texture,
                             const ParityQuery* queries, int count, ParityAnswer* answers) {
  const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (i >= count) return;
  const ParityQuery query = queries[i];
  answers[i] = Answer(bilinear, other, query);
  ReferencePatch patch;
  LoadReferencePatch(texture, query.col, query.row, texture.options.sigma_color, SingleThread(), &patch);
  answers[i].texture_cost =
      PhotometricCost(texture, patch, PlaneDual(texture, query.plane), query.col, query.row, query.view);
}

/// A copy on the device.
template <class T>
class OnDevice {
 public:
  OnDevice(const T* host, size_t count, const CudaDevicePtr& device, const CudaStream& stream) : array_(device, count) {
    array_.Upload(host, count, stream);
    stream.Synchronize();
  }
  T* data() const { return array_.data(); }

 private:
  DeviceArray<T> array_;
};

/// Uploads an image of the problem (rows without padding).
using Pixels = std::unique_ptr<OnDevice<float>>;
ImageView<const float> Upload(const ImageView<const float>& image, const CudaDevicePtr& device,
                              const CudaStream& stream, std::vector<Pixels>* owners) {
  if (image.empty()) return {};
  owners->push_back(
      std::make_unique<OnDevice<float>>(image.data, static_cast<size_t>(image.width) * image.height, device, stream));
  return {owners->back()->data(), image.width, image.height, image.width};
}

}  // namespace

std::vector<ParityAnswer> AnswerOnGpu(const PatchMatchProblem& problem, const std::vector<ParityQuery>& queries) {
  const auto device = std::make_shared<CudaDevice>(0);
  const CudaStream stream;
  PinnedBuffer staging;
  std::vector<Pixels> owners;
  auto texture = MakeMatchContext<TextureSampler>(problem, {}, Pass::kPhotometric, 0);
  std::vector<ImageView<const float>> images;
  std::vector<SourceView> views = MakeSourceViews(problem);
  const std::vector<HalvedDepthMap> depths = HalveDepths(problem);
  std::vector<std::unique_ptr<OnDevice<uint16_t>>> device_depths;
  for (size_t i = 0; i < views.size(); ++i) {
    const MatchView& source = problem.sources[i];
    images.push_back(Upload(source.gray, device, stream, &owners));
    views[i].depth = depths[i].View();
    if (!views[i].depth.empty()) {
      device_depths.push_back(
          std::make_unique<OnDevice<uint16_t>>(depths[i].inverse.data(), depths[i].inverse.size(), device, stream));
      views[i].depth.inverse.data = device_depths.back()->data();
    }
    int& layer = texture.sampler.layers[i];
    layer = device->images(0).Acquire(source.gray.width, source.gray.height, stream, &device->images_mutex());
    device->images(0).Upload(source.gray, layer, &staging, stream);
  }
  const ImageView<const float> reference = Upload(problem.reference.gray, device, stream, &owners);
  const OnDevice<SourceView> device_views(views.data(), views.size(), device, stream);
  const OnDevice<ImageView<const float>> device_images(images.data(), images.size(), device, stream);
  const OnDevice<ParityQuery> device_queries(queries.data(), queries.size(), device, stream);
  const DeviceArray<ParityAnswer> device_answers(device, queries.size());

  auto bilinear = MakeMatchContext<BilinearSampler>(problem, {}, Pass::kPhotometric, 0);
  bilinear.sampler = {reference, device_images.data()};
  bilinear.sources = device_views.data();
  auto other = MakeMatchContext<AbsoluteDifferenceSampler>(problem, {}, Pass::kPhotometric, 0);
  other.sampler = {bilinear.sampler};
  other.sources = device_views.data();
  texture.sampler.reference = device->images(0).Acquire(problem.reference.gray.width, problem.reference.gray.height,
                                                        stream, &device->images_mutex());
  device->images(0).Upload(problem.reference.gray, texture.sampler.reference, &staging, stream);
  texture.sampler.images = device->images(0).texture();
  texture.sources = device_views.data();

  constexpr int kBlock = 128;
  const int count = static_cast<int>(queries.size());
  AnswerKernel<<<(count + kBlock - 1) / kBlock, kBlock, 0, stream.get()>>>(
      bilinear, other, texture, device_queries.data(), count, device_answers.data());
  CudaCheck(cudaGetLastError(), "launch parity kernel");
  std::vector<ParityAnswer> answers(queries.size());
  device_answers.Download(answers.data(), answers.size(), stream);
  stream.Synchronize();
  return answers;
}

}  // namespace acmp
