#pragma once

#include <oneapi/tbb/task_arena.h>

#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

namespace acmp {

/// Keeps the values used last, up to a number of bytes. A value that is larger than all of it is handed out but not
/// kept. Any number of threads may ask; a value that several want is made once, and different ones at the same time.
template <class Key, class Value>
class LruCache {
 public:
  using Pointer = std::shared_ptr<const Value>;

  explicit LruCache(size_t max_bytes) : max_bytes_(max_bytes) {}

  /// The value of a key; made by `make` when it is not there. `bytes_of` says how large it is. What `make` throws goes
  /// to all who wait for the value, and the next one tries again.
  Pointer Get(const Key& key, const std::function<Pointer()>& make,
              const std::function<size_t(const Value&)>& bytes_of) {
    std::promise<Pointer> promise;
    std::shared_future<Pointer> made_elsewhere;
    uint64_t number = 0;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      const auto found = entries_.find(key);
      if (found != entries_.end()) {
        order_.splice(order_.begin(), order_, found->second.position);
        made_elsewhere = found->second.value;
      } else {
        number = next_number_++;
        std::list<Key> position = {key};
        entries_.emplace(key, Entry{promise.get_future().share(), number, false, 0, position.begin()});
        order_.splice(order_.begin(), position);  // cannot throw: both know the key, or none
      }
    }
    return made_elsewhere.valid() ? made_elsewhere.get() : Make(key, number, make, bytes_of, &promise);
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
  size_t size() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return entries_.size();
  }

 private:
  struct Entry {
    std::shared_future<Pointer> value;
    uint64_t number = 0;  ///< which of the entries that the key has had: who makes it must not touch a later one
    bool made = false;
    size_t bytes = 0;
    typename std::list<Key>::iterator position;
  };
  using Entries = std::map<Key, Entry>;

  Pointer Make(const Key& key, uint64_t number, const std::function<Pointer()>& make,
               const std::function<size_t(const Value&)>& bytes_of, std::promise<Pointer>* promise) {
    try {
      Pointer value;
      // While it waits for its own loops this thread must not take up work that waits for this value.
      tbb::this_task_arena::isolate([&] { value = make(); });
      Count(key, number, bytes_of(*value));
      promise->set_value(value);
      return value;
    } catch (...) {
      DropUnmade(key, number);  // first: who hears of the failure and tries again must not find it
      promise->set_exception(std::current_exception());
      throw;
    }
  }

  void DropUnmade(const Key& key, uint64_t number) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto entry = entries_.find(key);
    if (entry != entries_.end() && entry->second.number == number) Erase(entry);
  }

  void Count(const Key& key, uint64_t number, size_t bytes) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto entry = entries_.find(key);
    if (entry == entries_.end() || entry->second.number != number) return;  // dropped meanwhile
    entry->second.made = true;
    entry->second.bytes = bytes;
    bytes_ += bytes;
    while (bytes_ > max_bytes_) Erase(entries_.find(OldestMade()));
  }

  const Key& OldestMade() const {
    auto key = order_.end();
    do {
      --key;
    } while (!entries_.at(*key).made);
    return *key;
  }

  void Erase(typename Entries::iterator entry) {
    bytes_ -= entry->second.bytes;
    order_.erase(entry->second.position);
    entries_.erase(entry);
  }

  const size_t max_bytes_;
  mutable std::mutex mutex_;
  Entries entries_;
  std::list<Key> order_;  ///< used last first
  size_t bytes_ = 0;      ///< of all that are made
  uint64_t next_number_ = 0;
};

}  // namespace acmp
