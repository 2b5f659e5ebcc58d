#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>

namespace acmp {

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

  /// Waits for the callback that runs, if any; none runs afterwards. What is attached must be gone before this object.
  void Stop() { spinner_.stop(); }

 private:
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
};

}  // namespace acmp
