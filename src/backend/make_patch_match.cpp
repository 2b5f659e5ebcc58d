#include "acmp_mapping/backend/make_patch_match.h"

#include "acmp_mapping/common/error.h"
#ifdef ACMP_HAVE_CUDA
#include "acmp_mapping/backend/patch_match_cuda.h"
#endif

namespace acmp {
namespace {

#ifndef ACMP_HAVE_CUDA
std::unique_ptr<PatchMatch> MakePatchMatchCuda(int /*cuda_index*/) {
  throw InvalidInputError("this build has no CUDA backend (configure with -DACMP_CUDA=ON)");
}
#endif

}  // namespace

Device ParseDevice(const std::string& name) {
  if (name == "auto") return Device::kAuto;
  if (name == "cuda") return Device::kCuda;
  if (name == "cpu") return Device::kCpu;
  throw InvalidInputError(Concat("device = \"", name, "\": must be auto, cuda or cpu"));
}

PatchMatchBackend MakePatchMatch(Device device, int cuda_index) {
  PatchMatchBackend backend;
  if (device != Device::kCpu) {
    try {
      backend.patch_match = MakePatchMatchCuda(cuda_index);
      return backend;
    } catch (const std::runtime_error& error) {
      if (device == Device::kCuda) throw InvalidInputError(Concat("device = cuda: ", error.what()));
      backend.fallback_reason = error.what();
    }
  }
  backend.patch_match = MakePatchMatchCpu();
  return backend;
}

}  // namespace acmp
