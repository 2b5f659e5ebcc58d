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

/// Asks again and again until `holds()`; false after kTimeoutS.
template <class Condition>
bool WaitUntil(const Condition& holds) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kTimeoutS);
  while (!holds() && ros::ok() && ros::WallTime::now() < end) ros::WallDuration(0.02).sleep();
  return holds();
}

/// Whether a topic has publishers, and all of them send to this program. A subscriber counts a publisher
/// as soon as it has called it: what is published before that has read the call is lost. So they are asked themselves.
bool IsSentByAll(const std::string& topic);

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

  /// True as soon as `holds(messages)`; false after kTimeoutS, as all that follow.
  template <class Condition>
  bool WaitUntil(const Condition& holds) {
    std::unique_lock<std::mutex> lock(mutex_);
    return arrived_.wait_for(lock, std::chrono::duration<double>(kTimeoutS), [&] { return holds(messages_); });
  }

  bool WaitForCount(size_t count) {
    return WaitUntil([count](const std::vector<ConstPtr>& messages) { return messages.size() >= count; });
  }

  /// Waits for a newest message for which `holds(message)`.
  template <class Condition>
  bool WaitForNewest(const Condition& holds) {
    return WaitUntil([&](const auto& messages) { return !messages.empty() && holds(*messages.back()); });
  }

  /// Until at least one publisher is there, and all of them send to this program.
  bool WaitForPublisher() const {
    return test::WaitUntil([&] { return IsSentByAll(subscriber_.getTopic()); });
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
