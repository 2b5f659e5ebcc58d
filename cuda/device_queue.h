#pragma once

#include <memory>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "cuda_device.h"

namespace acmp {

/// One engine's way to its GPU, which the engine's parts share: a stream, a clock for what runs on it, and page-locked
/// memory.
class DeviceQueue {
 public:
  explicit DeviceQueue(CudaDevicePtr device) : device_(std::move(device)), stream_(device_->share()) {}

  const CudaDevicePtr& device() const { return device_; }
  const CudaStream& stream() const { return stream_; }
  /// For one copy at a time, which is waited for before the next use.
  PinnedBuffer* staging() { return &staging_; }

  void StartClock() { begin_.Record(stream_); }
  /// Waits for all that was queued and counts the device's time since StartClock.
  void FinishClock() {
    end_.Record(stream_);
    stream_.Synchronize();
    counted_ms_ += CudaEvent::ElapsedMs(begin_, end_);
  }
  /// What was counted since the last call, ms.
  double PopTime() { return std::exchange(counted_ms_, 0.0); }

  /// Throws InvalidInputError for null and for what belongs to another device.
  template <class Handle, class Base>
  const Handle& Cast(const std::shared_ptr<const Base>& handle) const {
    const auto* cast = dynamic_cast<const Handle*>(handle.get());
    if (cast == nullptr || cast->device != device_.get()) {
      throw InvalidInputError("a handle is null or belongs to another device");
    }
    return *cast;
  }

  /// Runs `work` with the device selected for this thread; after a failure nothing is left under way.
  template <class Work>
  auto OnDevice(const Work& work) -> decltype(work()) {
    device_->MakeCurrent();
    try {
      return work();
    } catch (...) {
      cudaStreamSynchronize(stream_.get());  // queued work must not outlive the memory it uses
      cudaGetLastError();
      throw;
    }
  }

 private:
  CudaDevicePtr device_;
  CudaStream stream_;
  CudaEvent begin_, end_;
  PinnedBuffer staging_;
  double counted_ms_ = 0;
};

}  // namespace acmp
