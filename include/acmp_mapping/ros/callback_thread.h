#pragma once

#include <future>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <boost/make_shared.hpp>

namespace acmp {

/// Waits until all callbacks that were queued before have returned; another thread calls them, one at a time. False
/// when the queue was disabled or cleared first.
inline bool DrainCallbacks(ros::CallbackQueue* queue) {
  struct Mark : ros::CallbackInterface {
    std::promise<void> reached;
    CallResult call() override {
      reached.set_value();
      return Success;
    }
  };
  auto mark = boost::make_shared<Mark>();
  std::future<void> reached = mark->reached.get_future();
  queue->addCallback(mark);
  mark.reset();  // the queue alone owns it: if it is cleared, the promise breaks and wakes us
  try {
    reached.get();
    return true;
  } catch (const std::future_error&) {
    return false;
  }
}

/// A callback queue with one thread of its own. The nodelet uses these instead of its manager's queues: roscpp keeps
/// plain pointers to queues in timers and subscriptions, and on unload the manager may destroy its queues while a
/// callback still keeps the nodelet, and with it timers and subscriptions, alive.
class CallbackThread {
 public:
  CallbackThread() : spinner_(1, &queue_) {}
  CallbackThread(const CallbackThread&) = delete;
  CallbackThread& operator=(const CallbackThread&) = delete;

  /// Subscriptions, services and timers made with the result have their callbacks here.
  ros::NodeHandle Attach(ros::NodeHandle nh) {
    nh.setCallbackQueue(&queue_);
    return nh;
  }

  void Start() { spinner_.start(); }

  /// Waits for the callback that runs, if any; none runs afterwards, and nobody waits in Drain. What is attached must
  /// be gone before this object.
  void Stop() {
    spinner_.stop();
    queue_.disable();
    queue_.clear();
  }

  /// Waits in another thread until all callbacks that were queued before have returned. False: Stop was called.
  bool Drain() { return DrainCallbacks(&queue_); }

 private:
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
};

}  // namespace acmp
