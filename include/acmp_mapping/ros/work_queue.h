#pragma once

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>
#include <variant>

namespace acmp {

/// What happens to a new input when kWorkQueueCapacity already wait.
enum class OverloadPolicy {
  kDropOldest,  ///< the oldest waiting input makes room
  kSkipIfBusy,  ///< an input is taken only when none waits and none is being worked on
  kBlock,       ///< the caller waits: nothing is lost, for recordings
};

constexpr size_t kWorkQueueCapacity = 2;  ///< inputs that one mapper works on; more would only add latency

/// Hands inputs and commands to one worker thread in the order given, urgent commands before all others. Inputs are
/// bounded by the policy, commands never wait for room and are never dropped. Thread-safe; all methods hold the one
/// mutex for a moment only, and no callback runs inside.
template <class Input, class Command>
class WorkQueue {
 public:
  using Item = std::variant<Input, Command>;

  explicit WorkQueue(OverloadPolicy policy) : policy_(policy) {}

  /// Returns the input that was not or no longer queued, if any: the oldest one or the new one itself.
  /// @param wait_for_room as with kBlock, whatever the policy
  std::optional<Input> Push(Input input, bool wait_for_room = false) {
    std::unique_lock<std::mutex> lock(mutex_);
    if (wait_for_room || policy_ == OverloadPolicy::kBlock) {
      room_.wait(lock, [this] { return stopped_ || inputs_ < kWorkQueueCapacity; });
    }
    if (stopped_) return input;
    std::optional<Input> dropped;
    if (policy_ == OverloadPolicy::kSkipIfBusy && !wait_for_room && (inputs_ > 0 || working_)) return input;
    if (inputs_ >= kWorkQueueCapacity) dropped = TakeOldestInput();
    items_.emplace_back(std::in_place_index<0>, std::move(input));
    ++inputs_;
    lock.unlock();
    work_.notify_one();
    return dropped;
  }

  /// False when the queue was stopped: the command will not run.
  bool PushCommand(Command command) { return PushCommandTo(&items_, std::move(command)); }
  bool PushUrgent(Command command) { return PushCommandTo(&urgent_, std::move(command)); }

  /// Takes out all waiting inputs; commands stay.
  std::deque<Input> ClearInputs() {
    std::deque<Input> cleared;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      while (inputs_ > 0) cleared.push_back(TakeOldestInput());
    }
    room_.notify_all();
    return cleared;
  }

  /// Waits for work; none once the queue is stopped. The worker counts as working from here to its next call.
  std::optional<Item> Pop() {
    std::unique_lock<std::mutex> lock(mutex_);
    working_ = false;
    work_.wait(lock, [&] { return stopped_ || !urgent_.empty() || !items_.empty(); });
    if (stopped_) return std::nullopt;
    std::deque<Item>& lane = urgent_.empty() ? items_ : urgent_;
    Item item = std::move(lane.front());
    lane.pop_front();
    if (item.index() == 0) --inputs_;
    working_ = true;
    lock.unlock();
    room_.notify_all();
    return item;
  }

  /// Wakes everybody who waits and throws away what is queued; from now on nothing is taken or given out.
  void Stop() {
    std::deque<Item> discarded, urgent_discarded;  // destroyed without the lock: commands may own anything
    {
      std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
      discarded.swap(items_);
      urgent_discarded.swap(urgent_);
      inputs_ = 0;
    }
    work_.notify_all();
    room_.notify_all();
  }

  size_t waiting_inputs() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return inputs_;
  }

 private:
  bool PushCommandTo(std::deque<Item>* lane, Command command) {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (stopped_) return false;
      lane->emplace_back(std::in_place_index<1>, std::move(command));
    }
    work_.notify_one();
    return true;
  }

  Input TakeOldestInput() {
    const auto oldest = std::find_if(items_.begin(), items_.end(), [](const Item& item) { return item.index() == 0; });
    Input input = std::move(std::get<0>(*oldest));
    items_.erase(oldest);
    --inputs_;
    return input;
  }

  const OverloadPolicy policy_;
  mutable std::mutex mutex_;
  std::condition_variable work_;
  std::condition_variable room_;
  std::deque<Item> items_;
  std::deque<Item> urgent_;
  size_t inputs_ = 0;
  bool working_ = false;
  bool stopped_ = false;
};

}  // namespace acmp
