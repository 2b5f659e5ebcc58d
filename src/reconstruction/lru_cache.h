#pragma once

#include <tbb/task_arena.h>

#include <cstddef>
#include <functional>
#include <limits>
#include <list>
#include <map>
#include <memory>
#include <mutex>

namespace acmp {

/// Keeps the values used last, up to a number of bytes and of values. A value that is larger than all of it is handed
/// out but not kept. Any number of threads may ask; a value that several want is made once, and different ones at the
/// same time.
template <class Key, class Value>
class LruCache {
 public:
  using Pointer = std::shared_ptr<const Value>;

  explicit LruCache(size_t max_bytes, size_t max_values = std::numeric_limits<size_t>::max())
      : max_bytes_(max_bytes), max_values_(max_values) {}

  /// The value of a key; made by `make` when it is not there. `bytes_of` says how large it is. Where `make` throws,
  /// each of those who wait for the value tries for himself.
  Pointer Get(const Key& key, const std::function<Pointer()>& make,
              const std::function<size_t(const Value&)>& bytes_of) {
    const std::shared_ptr<Slot> slot = Touch(key);
    const std::lock_guard<std::mutex> lock(slot->mutex);
    if (!slot->value) {
      // While it waits for its own loops this thread must not take up work that waits for this value.
      tbb::this_task_arena::isolate([&] { slot->value = make(); });
      Count(key, slot, bytes_of(*slot->value));
    }
    return slot->value;
  }

  /// Forgets a value; no effect when it is not there. One that is being made still goes to all who wait for it, but is
  /// not kept.
  void Drop(const Key& key) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = entries_.find(key);
    if (found != entries_.end()) Erase(found);
  }

  size_t bytes() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return bytes_;
  }

 private:
  struct Slot {
    std::mutex mutex;  ///< held while the value is made
    Pointer value;
  };
  struct Entry {
    std::shared_ptr<Slot> slot;
    size_t bytes = 0;  ///< 0: not made yet
    typename std::list<Key>::iterator place;
  };
  using Entries = std::map<Key, Entry>;

  /// The slot of a key, which is the one used last from now on.
  std::shared_ptr<Slot> Touch(const Key& key) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = entries_.find(key); found != entries_.end()) {
      order_.splice(order_.begin(), order_, found->second.place);
      return found->second.slot;
    }
    order_.push_front(key);
    return entries_.emplace(key, Entry{std::make_shared<Slot>(), 0, order_.begin()}).first->second.slot;
  }

  void Count(const Key& key, const std::shared_ptr<Slot>& slot, size_t bytes) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto entry = entries_.find(key);
    if (entry == entries_.end() || entry->second.slot != slot) return;  // dropped meanwhile
    entry->second.bytes = bytes;
    bytes_ += bytes;
    ++values_;
    const auto is_full = [&] { return bytes_ > max_bytes_ || values_ > max_values_; };
    for (auto oldest = order_.end(); is_full() && oldest != order_.begin();) {
      const auto found = entries_.find(*--oldest);
      if (found->second.bytes == 0) continue;
      ++oldest;  // before it goes
      Erase(found);
    }
  }

  void Erase(typename Entries::iterator entry) {
    bytes_ -= entry->second.bytes;
    if (entry->second.bytes > 0) --values_;
    order_.erase(entry->second.place);
    entries_.erase(entry);
  }

  const size_t max_bytes_, max_values_;
  mutable std::mutex mutex_;
  Entries entries_;
  std::list<Key> order_;  ///< used last first
  size_t bytes_ = 0;      ///< of all that are made
  size_t values_ = 0;     ///< that are made
};

}  // namespace acmp
