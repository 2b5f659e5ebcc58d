#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <vector>

#include <ros/ros.h>

namespace acmp::test {

/// How long tests wait for what takes some seconds: so long that only something that hangs fails. rostest's time-limit
/// is longer.
constexpr double kTimeoutS = 400;

/// Asks again and again until `holds()`; false after `timeout_s`.
template <class Condition>
bool WaitUntil(const Condition& holds, double timeout_s) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(timeout_s);
  while (!holds() && ros::ok() && ros::WallTime::now() < end) ros::WallDuration(0.02).sleep();
  return holds();
}

/// As ros::service::call, over a connection that is kept until the answer has been read. roscpp ends others when it has
/// sent the answer; a caller that has just sent its request and does not read yet, since the machine is busy, then
/// takes the call for failed (TransportTCP::socketUpdate, ros_comm issue 1976).
template <class Service>
bool CallService(const std::string& name, Service* service) {
  constexpr bool kPersistent = true;
  return ros::NodeHandle().serviceClient<Service>(name, kPersistent).call(*service);
}

/// Keeps every message of a topic. Needs a spinner in another thread.
template <class Message>
class Recorder {
 public:
  using ConstPtr = typename Message::ConstPtr;

  Recorder(ros::NodeHandle nh, const std::string& topic) {
    const boost::function<void(const ConstPtr&)> callback = [this](const ConstPtr& message) {
      {
        std::lock_guard<std::mutex> lock(mutex_);
        messages_.push_back(message);
      }
      arrived_.notify_all();
    };
    subscriber_ = nh.subscribe<Message>(topic, 1000, callback);
  }
  ~Recorder() { subscriber_.shutdown(); }

  /// True as soon as `holds(messages)`; false after `timeout_s`.
  template <class Condition>
  bool WaitUntil(const Condition& holds, double timeout_s) {
    std::unique_lock<std::mutex> lock(mutex_);
    return arrived_.wait_for(lock, std::chrono::duration<double>(timeout_s), [&] { return holds(messages_); });
  }

  bool WaitForCount(size_t count, double timeout_s) {
    return WaitUntil([count](const std::vector<ConstPtr>& messages) { return messages.size() >= count; }, timeout_s);
  }

  /// Until `count` publishers are connected; false after `timeout_s`.
  bool WaitForPublisher(double timeout_s, uint32_t count = 1) const {
    return test::WaitUntil([&] { return subscriber_.getNumPublishers() >= count; }, timeout_s);
  }

  std::vector<ConstPtr> messages() {
    std::lock_guard<std::mutex> lock(mutex_);
    return messages_;
  }

  void Clear() {
    std::lock_guard<std::mutex> lock(mutex_);
    messages_.clear();
  }

 private:
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<ConstPtr> messages_;
  ros::Subscriber subscriber_;  // last: its callback uses what is above
};

}  // namespace acmp::test
