#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>

namespace acmp {

/// Which inputs are worked on when they come faster than they can be.
enum class OverloadPolicy {
  kDrop,        ///< those that have waited for less than kLongestWaitS, in groups of at least kInputGroup in a row;
                ///< the others are overtaken
  kSkipIfBusy,  ///< an input that comes while nothing waits and nothing is worked on; the others are overtaken
  kBlock,       ///< all that fit into memory: for recordings
};

/// What takes long once in a while delays inputs, and loses none: those that waited are caught up with.
constexpr double kLongestWaitS = 0.5;
/// Neighbours confirm each other's depth, which takes three of them; single keyframes far apart would have no points.
constexpr size_t kInputGroup = 4;
/// That wait at most, beside a group: half of the default window, which overtaken ones must not fill.
constexpr size_t kWaitingInputs = 15;

/// Hands inputs and commands to one worker thread in the order given, urgent commands before all else. Nobody waits to
/// put something in. Inputs are bounded by the policy, commands are never dropped. Thread-safe; all methods hold the
/// one mutex for a moment only, and no callback runs inside.
template <class Input, class Command>
class WorkQueue {
 public:
  struct Item {
    std::optional<Input> input;  ///< none: a command
    std::optional<Command> command = {};
    bool overtaken = false;  ///< there is no time for the input: the keyframe serves as a source view only
    bool must_wait = false;  ///< never overtaken
    double since_s = 0;      ///< when it was pushed
    size_t bytes = 0;        ///< that the input takes

    bool is_idle() const { return !input && !command; }
  };

  /// @param max_bytes of all inputs that wait, where the policy takes all; one always may
  /// @param now_s a steady clock, s
  WorkQueue(OverloadPolicy policy, size_t max_bytes, std::function<double()> now_s)
      : policy_(policy), max_bytes_(max_bytes), now_s_(std::move(now_s)) {}

  /// Returns the input that is not or no longer queued, if any: of too many the oldest that does not belong to the
  /// group that is worked on; the new one itself where there are too many bytes, or when the queue was stopped.
  /// @param bytes that it takes
  /// @param must_wait as with kBlock, whatever the policy
  std::optional<Input> Push(Input input, size_t bytes, bool must_wait = false) {
    std::unique_lock<std::mutex> lock(mutex_);
    const bool takes_all = must_wait || policy_ == OverloadPolicy::kBlock;
    if (stopped_ || (takes_all && inputs_ > 0 && bytes_ + bytes > max_bytes_)) return input;
    const bool skips = !takes_all && policy_ == OverloadPolicy::kSkipIfBusy && (inputs_ > 0 || working_);
    items_.push_back({std::move(input), {}, skips, takes_all, now_s_(), bytes});
    Count(items_.back());
    std::optional<Input> dropped;
    if (!takes_all && inputs_ > kWaitingInputs + kInputGroup) dropped = TakeOldest();
    lock.unlock();
    work_.notify_one();
    return dropped;
  }

  /// False when the queue was stopped: the command will not run.
  bool PushCommand(Command command, bool urgent = false) {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (stopped_) return false;
      Item item;
      item.command = std::move(command);
      items_.insert(urgent ? items_.begin() : items_.end(), std::move(item));
    }
    work_.notify_one();
    return true;
  }

  /// Takes out all waiting inputs, those that were overtaken too; commands stay.
  std::deque<Input> ClearInputs() {
    std::deque<Input> cleared;
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
    inputs_ = bytes_ = 0;
    return cleared;
  }

  /// Waits for work; none once the queue is stopped. The worker counts as working from here to its next call.
  /// @param longest_s an idle item where nothing has come for so long; none: waits for ever
  std::optional<Item> Pop(std::optional<double> longest_s = std::nullopt) {
    std::unique_lock<std::mutex> lock(mutex_);
    working_ = false;
    const auto has_work = [this] { return stopped_ || !items_.empty(); };
    if (!longest_s) work_.wait(lock, has_work);
    if (longest_s && !work_.wait_for(lock, std::chrono::duration<double>(*longest_s), has_work)) return Item{};
    if (stopped_) return std::nullopt;
    Item item = std::move(items_.front());
    items_.pop_front();
    if (item.input) {
      Uncount(item);
      if (policy_ == OverloadPolicy::kDrop && !item.must_wait) item.overtaken = !HasTime(item);
    }
    working_ = true;
    return item;
  }

  /// Wakes everybody who waits and throws away what is queued; from now on nothing is taken or given out.
  void Stop() {
    std::deque<Item> discarded;  // destroyed without the lock: commands may own anything
    {
      std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
      discarded.swap(items_);
      inputs_ = bytes_ = 0;
    }
    work_.notify_all();
  }

  size_t waiting_inputs() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return inputs_;
  }

 private:
  /// Whether an input is worked on that has its turn now. One in time begins a group anew.
  bool HasTime(const Item& item) {
    if (now_s_() - item.since_s <= kLongestWaitS) {
      left_of_group_ = kInputGroup - 1;
      return true;
    }
    if (left_of_group_ == 0) return false;
    --left_of_group_;
    return true;
  }

  /// After those that still belong to the group.
  Input TakeOldest() {
    size_t kept = policy_ == OverloadPolicy::kDrop ? left_of_group_ : 0;
    auto oldest = items_.begin();
    for (;; ++oldest) {
      if (!oldest->input || oldest->must_wait) continue;
      if (policy_ == OverloadPolicy::kSkipIfBusy && !oldest->overtaken) continue;
      if (kept == 0) break;
      --kept;
    }
    Input input = std::move(*oldest->input);
    Uncount(*oldest);
    items_.erase(oldest);
    return input;
  }

  void Count(const Item& item) { ++inputs_, bytes_ += item.bytes; }
  void Uncount(const Item& item) { --inputs_, bytes_ -= item.bytes; }

  const OverloadPolicy policy_;
  const size_t max_bytes_;
  const std::function<double()> now_s_;
  mutable std::mutex mutex_;
  std::condition_variable work_;
  std::deque<Item> items_;
  size_t inputs_ = 0, bytes_ = 0;       ///< that wait
  size_t left_of_group_ = kInputGroup;  ///< inputs that are worked on although they have waited long
  bool working_ = false;
  bool stopped_ = false;
};

}  // namespace acmp
