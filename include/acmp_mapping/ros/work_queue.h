#pragma once

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

namespace acmp {

/// Which inputs are worked on when they come faster than they can be.
enum class OverloadPolicy {
  kDrop,        ///< groups of kInputGroup inputs in a row; what comes until they have been taken up is overtaken
  kSkipIfBusy,  ///< an input that comes while nothing waits and nothing is worked on; the others are overtaken
  kBlock,       ///< all: the caller waits, for recordings
};

constexpr size_t kBlockedInputs = 2;  ///< that wait with kBlock; more would only take memory
/// Neighbours confirm each other's depth, which takes three of them; single keyframes far apart would have no points.
constexpr size_t kInputGroup = 4;
constexpr size_t kOvertakenInputs = 15;  ///< that wait at most: half of the default window, which they must not fill

/// Hands inputs and commands to one worker thread in the order given, urgent commands before all else. Inputs are
/// bounded by the policy, commands never wait for room and are never dropped. Thread-safe; all methods hold the one
/// mutex for a moment only, and no callback runs inside.
template <class Input, class Command>
class WorkQueue {
 public:
  struct Item {
    std::optional<Input> input;  ///< none: a command
    Command command = {};
    bool overtaken = false;  ///< there is no time for the input: the keyframe serves as a source view only
  };

  explicit WorkQueue(OverloadPolicy policy) : policy_(policy) {}

  /// Returns the input that is not or no longer queued, if any: the oldest of too many overtaken ones, or, when the
  /// queue was stopped, the new one itself.
  /// @param wait_for_room as with kBlock, whatever the policy
  std::optional<Input> Push(Input input, bool wait_for_room = false) {
    std::unique_lock<std::mutex> lock(mutex_);
    const bool takes_all = wait_for_room || policy_ == OverloadPolicy::kBlock;
    if (takes_all) room_.wait(lock, [this] { return stopped_ || inputs_ < kBlockedInputs; });
    if (stopped_) return input;
    std::optional<Input> dropped;
    const bool has_time = takes_all || HasTime();
    items_.push_back({std::move(input), {}, !has_time});
    if (has_time) {
      ++inputs_;
    } else if (++overtaken_ > kOvertakenInputs) {
      dropped = TakeOldestOvertaken();
    }
    lock.unlock();
    work_.notify_one();
    return dropped;
  }

  /// False when the queue was stopped: the command will not run.
  bool PushCommand(Command command, bool urgent = false) {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (stopped_) return false;
      items_.insert(urgent ? items_.begin() : items_.end(), Item{std::nullopt, std::move(command)});
    }
    work_.notify_one();
    return true;
  }

  /// Takes out all waiting inputs, those that were overtaken too; commands stay.
  std::deque<Input> ClearInputs() {
    std::deque<Input> cleared;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      std::deque<Item> commands;
      for (Item& item : items_) {
        if (item.input) {
          cleared.push_back(std::move(*item.input));
        } else {
          commands.push_back(std::move(item));
        }
      }
      items_ = std::move(commands);
      inputs_ = overtaken_ = 0;
    }
    room_.notify_all();
    return cleared;
  }

  /// Waits for work; none once the queue is stopped. The worker counts as working from here to its next call.
  std::optional<Item> Pop() {
    std::optional<Item> item;
    std::unique_lock<std::mutex> lock(mutex_);
    working_ = false;
    work_.wait(lock, [&] { return stopped_ || !items_.empty(); });
    if (stopped_) return item;
    item = std::move(items_.front());
    items_.pop_front();
    if (item->input) --(item->overtaken ? overtaken_ : inputs_);
    working_ = true;
    lock.unlock();
    room_.notify_all();
    return item;
  }

  /// Wakes everybody who waits and throws away what is queued; from now on nothing is taken or given out.
  void Stop() {
    std::deque<Item> discarded;  // destroyed without the lock: commands may own anything
    {
      std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
      discarded.swap(items_);
      inputs_ = overtaken_ = 0;
    }
    work_.notify_all();
    room_.notify_all();
  }

  size_t waiting_inputs() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return inputs_;
  }

 private:
  /// Whether a new input is worked on; not asked with kBlock.
  bool HasTime() {
    if (policy_ == OverloadPolicy::kSkipIfBusy) return inputs_ == 0 && !working_;
    if (inputs_ == 0) group_ = 0;
    return group_++ < kInputGroup;
  }

  Input TakeOldestOvertaken() {
    const auto oldest = std::find_if(items_.begin(), items_.end(), [](const Item& item) { return item.overtaken; });
    Input input = std::move(*oldest->input);
    items_.erase(oldest);
    --overtaken_;
    return input;
  }

  const OverloadPolicy policy_;
  mutable std::mutex mutex_;
  std::condition_variable work_;
  std::condition_variable room_;
  std::deque<Item> items_;
  size_t inputs_ = 0;     ///< that wait, without the overtaken ones
  size_t overtaken_ = 0;  ///< that wait
  size_t group_ = 0;      ///< inputs that came since none waited
  bool working_ = false;
  bool stopped_ = false;
};

}  // namespace acmp
