#include "no_device_reason.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>

#include "acmp_mapping/common/error.h"

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

}  // namespace acmp
