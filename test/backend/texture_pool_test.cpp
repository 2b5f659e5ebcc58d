#include "texture_pool.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <shared_mutex>
#include <thread>
#include <vector>

namespace {
std::atomic<int> allocations{0};
}  // namespace

// The linker sends all calls of cudaMalloc3DArray here (--wrap in CMakeLists.txt).
extern "C" {
cudaError_t __real_cudaMalloc3DArray(cudaArray_t*, const cudaChannelFormatDesc*, cudaExtent, unsigned int);  // NOLINT
cudaError_t __wrap_cudaMalloc3DArray(cudaArray_t* array, const cudaChannelFormatDesc* format,                // NOLINT
                                     cudaExtent extent, unsigned int flags) {
  ++allocations;
  return __real_cudaMalloc3DArray(array, format, extent, flags);
}
}

namespace acmp {
namespace {

TEST(TexturePoolTest, EnginesThatWaitForAGrowingPoolGrowItOnce) {
  int devices = 0;
  if (cudaGetDeviceCount(&devices) != cudaSuccess || devices == 0) GTEST_SKIP() << "needs a GPU";
  constexpr int kEngines = 8;  // all fit into the first 16 layers
  TexturePool pool;
  FairSharedMutex images;
  std::vector<int> layers(kEngines);
  std::vector<std::thread> engines;
  std::atomic<int> begun{0};
  {
    const std::shared_lock<FairSharedMutex> pass(images);  // nobody may grow the pool while one reads it
    for (int i = 0; i < kEngines; ++i) {
      engines.emplace_back([&, i] {
        const CudaStream stream;
        ++begun;
        layers[i] = pool.Acquire(64, 48, stream, &images);
      });
    }
    while (begun < kEngines) std::this_thread::yield();
    // That all have seen an empty pool and wait. On a slow machine fewer do, and the test sees less.
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    EXPECT_EQ(allocations, 0);
  }
  for (std::thread& engine : engines) engine.join();
  EXPECT_EQ(allocations, 1);
  std::sort(layers.begin(), layers.end());
  EXPECT_EQ(std::unique(layers.begin(), layers.end()), layers.end()) << "each has a layer of its own";
  EXPECT_EQ(pool.Bytes(), 16u * 64 * 48 * sizeof(uint16_t));
}

}  // namespace
}  // namespace acmp
