#pragma once

#include <mutex>
#include <shared_mutex>

namespace acmp {

/// A shared mutex in which whoever waits to be alone goes before readers that come later. In glibc's they go first:
/// readers that overlap would keep it waiting for ever.
class FairSharedMutex {
 public:
  void lock() {
    const std::lock_guard<std::mutex> door(door_);
    mutex_.lock();
  }
  void unlock() { mutex_.unlock(); }
  void lock_shared() {
    const std::lock_guard<std::mutex> door(door_);
    mutex_.lock_shared();
  }
  bool try_lock_shared() {
    const std::unique_lock<std::mutex> door(door_, std::try_to_lock);
    return door.owns_lock() && mutex_.try_lock_shared();
  }
  void unlock_shared() { mutex_.unlock_shared(); }

 private:
  std::mutex door_;  ///< held by the one who is next
  std::shared_mutex mutex_;
};

}  // namespace acmp
