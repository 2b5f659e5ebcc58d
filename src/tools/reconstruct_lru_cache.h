#pragma once

#include <cstddef>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <utility>

namespace acmp {

/// Keeps the values used last, up to a number of bytes. A value that is larger than all of it is handed out but not
/// kept.
template <class Key, class Value>
class LruCache {
 public:
  using Pointer = std::shared_ptr<const Value>;

  explicit LruCache(size_t max_bytes) : max_bytes_(max_bytes) {}

  /// The value of a key; made by `make` when it is not there. `bytes_of` says how large it is.
  Pointer Get(const Key& key, const std::function<Pointer()>& make,
              const std::function<size_t(const Value&)>& bytes_of) {
    const auto found = entries_.find(key);
    if (found != entries_.end()) {
      order_.splice(order_.begin(), order_, found->second.position);
      return found->second.value;
    }
    Pointer value = make();
    const size_t bytes = bytes_of(*value);
    order_.push_front(key);
    entries_[key] = {value, bytes, order_.begin()};
    bytes_ += bytes;
    while (bytes_ > max_bytes_) DropOldest();
    return value;
  }

  void Clear() {
    entries_.clear();
    order_.clear();
    bytes_ = 0;
  }

  size_t bytes() const { return bytes_; }
  size_t size() const { return entries_.size(); }

 private:
  struct Entry {
    Pointer value;
    size_t bytes = 0;
    typename std::list<Key>::iterator position;
  };

  void DropOldest() {
    const auto oldest = entries_.find(order_.back());
    bytes_ -= oldest->second.bytes;
    entries_.erase(oldest);
    order_.pop_back();
  }

  size_t max_bytes_;
  size_t bytes_ = 0;
  std::list<Key> order_;  ///< last used first
  std::map<Key, Entry> entries_;
};

}  // namespace acmp
