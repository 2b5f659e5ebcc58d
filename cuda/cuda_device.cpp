#include "cuda_device.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <exception>
#include <filesystem>

#include "acmp_mapping/common/error.h"
#include "kernels.h"

namespace acmp {
namespace {

std::string VersionName(int version) { return Concat(version / 1000, ".", version % 1000 / 10); }

}  // namespace

std::string NoDeviceReason(cudaError_t status, int driver, int runtime, const std::string& forbidden) {
  if (driver == 0) {
    return "no NVIDIA driver on this machine: install it; in a container, start that with its GPUs (docker run --gpus "
           "all)";
  }
  if (status == cudaErrorInsufficientDriver) {
    return Concat("the NVIDIA driver is too old: it knows CUDA up to ", VersionName(driver), ", this build is of CUDA ",
                  VersionName(runtime), ": update the driver, or build with an older CUDA toolkit");
  }
  if (!forbidden.empty()) {
    return Concat("no permission to read and write ", forbidden, ": add the user to the group that may (ls -l ",
                  forbidden, ")");
  }
  if (status == cudaErrorNoDevice) return "the NVIDIA driver finds no GPU";
  return cudaGetErrorString(status);
}

std::string ForbiddenDeviceFile(const std::string& folder) {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    // nvidia0, nvidiactl, nvidia-uvm; of Jetson boards nvmap and nvhost-*.
    const bool is_gpu = name.rfind("nvidia", 0) == 0 || name == "nvmap" || name.rfind("nvhost-", 0) == 0;
    if (!is_gpu || entry.is_directory(error)) continue;
    if (faccessat(AT_FDCWD, entry.path().c_str(), R_OK | W_OK, AT_EACCESS) != 0 && errno == EACCES) {
      return entry.path().string();
    }
  }
  return "";
}

CudaDevice::CudaDevice(int index) : index_(index) {
  int count = 0;
  const cudaError_t status = cudaGetDeviceCount(&count);
  if (status != cudaSuccess) {
    int driver = 0;
    int runtime = 0;
    cudaDriverGetVersion(&driver);
    cudaRuntimeGetVersion(&runtime);
    throw InvalidInputError(
        Concat("no usable CUDA device: ", NoDeviceReason(status, driver, runtime, ForbiddenDeviceFile("/dev"))));
  }
  if (index < 0 || index >= count) {
    throw InvalidInputError(Concat("CUDA device index = ", index, ": must be in [0, ", count - 1, "]"));
  }
  MakeCurrent();
  CudaCheck(cudaGetDeviceProperties(&properties_, index), "read device properties");
  const cudaError_t probe = ProbeKernels();
  if (probe != cudaSuccess) {
    cudaGetLastError();
    throw InvalidInputError(Concat("this build has no code for ", properties_.name, " (compute capability ",
                                   properties_.major, ".", properties_.minor, ": ", cudaGetErrorString(probe),
                                   "); configure with -DACMP_CUDA_ARCHITECTURES=", properties_.major,
                                   properties_.minor));
  }
  memory_stream_ = std::make_unique<CudaStream>();
  cudaMemPoolProps pool = {};
  pool.allocType = cudaMemAllocationTypePinned;
  pool.location = {cudaMemLocationTypeDevice, index};
  CudaCheck(cudaMemPoolCreate(&pool_, &pool), "create memory pool");
  uint64_t keep_all = UINT64_MAX;
  CudaCheck(cudaMemPoolSetAttribute(pool_, cudaMemPoolAttrReleaseThreshold, &keep_all), "set up memory pool");
}

CudaDevice::~CudaDevice() {
  cudaSetDevice(index_);
  if (memory_stream_) cudaStreamSynchronize(memory_stream_->get());
  cudaMemPoolDestroy(pool_);
}

void CudaDevice::MakeCurrent() const { CudaCheck(cudaSetDevice(index_), "select device"); }

std::unique_lock<std::mutex> CudaDevice::PassTurn(size_t pixels) {
  // 8 threads per pixel of one colour: some 40 times what a multiprocessor holds at once.
  constexpr size_t kManyPixels = 8192;  // per multiprocessor
  if (pixels < kManyPixels * static_cast<size_t>(properties_.multiProcessorCount)) return {};
  return std::unique_lock<std::mutex>(pass_turn_);
}

void* CudaDevice::Allocate(size_t bytes) {
  void* data = nullptr;
  const cudaError_t status = cudaMallocFromPoolAsync(&data, bytes, pool_, memory_stream_->get());
  if (status != cudaSuccess) {
    cudaGetLastError();  // out of memory is not sticky: the device stays usable
    CudaCheck(status, Concat("allocate ", bytes, " bytes of GPU memory").c_str());
  }
  memory_stream_->Synchronize();  // other streams may use it from now on
  return data;
}

// Called by destructors, in any thread: an error here would show again in the next call that can report it.
void CudaDevice::Free(void* data) noexcept {
  cudaSetDevice(index_);
  if (std::uncaught_exceptions() > 0) cudaDeviceSynchronize();  // nobody has waited for what was queued before it
  cudaFreeAsync(data, memory_stream_->get());
}

size_t CudaDevice::Bytes() const {
  uint64_t bytes = 0;
  CudaCheck(cudaMemPoolGetAttribute(pool_, cudaMemPoolAttrReservedMemCurrent, &bytes), "read memory pool");
  for (const TexturePool& images : images_) bytes += images.Bytes();
  return bytes;
}

}  // namespace acmp
