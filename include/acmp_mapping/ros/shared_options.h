#pragma once

#include <mutex>

#include "acmp_mapping/ros/runtime_options.h"

namespace acmp {

/// The runtime options, set by dynamic_reconfigure and copied by the threads that use them. Thread-safe.
class SharedOptions {
 public:
  explicit SharedOptions(const RuntimeOptions& options) : options_(options) {}

  void Set(const RuntimeOptions& options) {
    std::lock_guard<std::mutex> lock(mutex_);
    options_ = options;
  }

  RuntimeOptions Get() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return options_;
  }

 private:
  mutable std::mutex mutex_;
  RuntimeOptions options_;
};

}  // namespace acmp
