#pragma once

#include <cuda_runtime_api.h>

namespace acmp {

/// Some of a GPU's multiprocessors (a green context): what is queued on its streams runs on these alone, so that a
/// large GPU shows how long a small one takes. Memory, clocks and caches stay the large GPU's.
class MultiprocessorShare {
 public:
  /// @param device index of the GPU, which is selected for the calling thread
  /// @param count at least so many multiprocessors; GPUs give them out by twos or more
  /// Throws InvalidInputError where the GPU has fewer, or toolkit or driver are older than CUDA 12.5.
  MultiprocessorShare(int device, int count);
  ~MultiprocessorShare();
  MultiprocessorShare(const MultiprocessorShare&) = delete;
  MultiprocessorShare& operator=(const MultiprocessorShare&) = delete;

  int count() const { return count_; }
  /// A non-blocking stream. Whoever asks destroys it, before the share.
  cudaStream_t MakeStream() const;

 private:
  int count_ = 0;
  void* context_ = nullptr;  ///< CUgreenCtx
};

}  // namespace acmp
