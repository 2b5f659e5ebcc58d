#include <algorithm>
#include <memory>

#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_resources.h"
#include "support/absolute_difference.h"

namespace acmp {
namespace {

__global__ void CostKernel(const MatchContext<AbsoluteDifferenceSampler> context, const CostQuery* queries, int count,
                           float* costs) {
  const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (i < count) costs[i] = Cost(context, queries[i]);
}

/// A copy in memory that CPU and GPU read.
template <class T>
std::shared_ptr<T> Copy(const T* from, size_t count) {
  void* data = nullptr;
  CudaCheck(cudaMallocManaged(&data, count * sizeof(T)), "allocate");
  std::copy_n(from, count, static_cast<T*>(data));
  return {static_cast<T*>(data), [](T* freed) { cudaFree(freed); }};
}

}  // namespace

std::vector<float> CostsOnGpu(const PatchMatchProblem& problem, const std::vector<CostQuery>& queries) {
  std::vector<std::shared_ptr<float>> pixels;
  const auto copy_of = [&](const ImageView<const float>& image) -> ImageView<const float> {
    pixels.push_back(Copy(image.data, static_cast<size_t>(image.width) * image.height));  // rows without padding
    return {pixels.back().get(), image.width, image.height, image.width};
  };
  std::vector<ImageView<const float>> images;
  for (const MatchView& source : problem.sources) images.push_back(copy_of(source.gray));
  const auto views = MakeSourceViews(problem);
  const auto device_images = Copy(images.data(), images.size());
  const auto device_views = Copy(views.data(), views.size());
  const auto device_queries = Copy(queries.data(), queries.size());
  std::vector<float> costs(queries.size());
  const auto device_costs = Copy(costs.data(), costs.size());
  auto context = MakeMatchContext<AbsoluteDifferenceSampler>(problem, {}, Pass::kPhotometric, 0);
  context.sampler = {copy_of(problem.reference.gray), device_images.get()};
  context.sources = device_views.get();
  constexpr int kBlock = 128;
  const int count = static_cast<int>(queries.size());
  const CudaStream stream;
  CostKernel<<<(count + kBlock - 1) / kBlock, kBlock, 0, stream.get()>>>(context, device_queries.get(), count,
                                                                         device_costs.get());
  CudaCheck(cudaGetLastError(), "launch costs");
  stream.Synchronize();
  std::copy_n(device_costs.get(), costs.size(), costs.begin());
  return costs;
}

}  // namespace acmp
