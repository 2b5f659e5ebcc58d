#pragma once

#include <exception>
#include <functional>
#include <future>
#include <new>
#include <string>
#include <utility>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <xmlrpcpp/XmlRpcException.h>
#include <boost/make_shared.hpp>

namespace acmp {

/// Told what an exception says.
using FailureReport = std::function<void(const std::string&)>;

/// Calls a function of a callback, a timer or a thread. What it throws is told and goes no further: an exception that
/// leaves one of these would end the whole nodelet manager.
template <class Function>
void CallGuarded(const Function& function, const FailureReport& report) {
  try {
    try {
      function();
    } catch (const std::bad_alloc&) {
      report("out of memory");
    } catch (const std::exception& error) {
      report(error.what());
    } catch (const XmlRpc::XmlRpcException& error) {  // no std::exception
      report(error.getMessage());
    } catch (...) {
      report("an exception that says nothing");
    }
  } catch (...) {  // of the report: there is no memory for it
  }
}

/// A callback queue whose callbacks are guarded, see CallGuarded.
class GuardedQueue : public ros::CallbackQueue {
 public:
  /// @param report told what callbacks throw; runs in the thread that calls them
  explicit GuardedQueue(FailureReport report) : report_(std::move(report)) {}

  void addCallback(const ros::CallbackInterfacePtr& callback, uint64_t owner) override {
    CallbackQueue::addCallback(boost::make_shared<Guarded>(callback, &report_), owner);
  }

  /// Has a function called when all callbacks that were queued before have returned. What it throws, the future has:
  /// std::future_error when the queue was disabled or cleared first.
  std::future<void> Queue(std::function<void()> function) {
    auto callback = boost::make_shared<Task>();
    callback->task = std::packaged_task<void()>(std::move(function));
    std::future<void> returned = callback->task.get_future();
    addCallback(callback, 0);
    return returned;  // the queue alone owns the callback: if it is cleared, the promise breaks
  }

  /// The same, and waits for it in another thread than that which calls. What it throws is thrown here. False, and it
  /// is not called, when the queue was disabled or cleared first.
  bool Call(std::function<void()> function) {
    try {
      Queue(std::move(function)).get();
      return true;
    } catch (const std::future_error&) {
      return false;
    }
  }

 private:
  struct Guarded : ros::CallbackInterface {
    Guarded(ros::CallbackInterfacePtr guarded, const FailureReport* told)
        : callback(std::move(guarded)), report(told) {}
    CallResult call() override {
      CallResult result = Invalid;
      CallGuarded([&] { result = callback->call(); }, *report);
      return result;
    }
    bool ready() override { return callback->ready(); }
    const ros::CallbackInterfacePtr callback;
    const FailureReport* const report;
  };
  struct Task : ros::CallbackInterface {
    std::packaged_task<void()> task;
    CallResult call() override {
      task();
      return Success;
    }
  };

  const FailureReport report_;
};

/// A guarded callback queue with one thread of its own. The nodelet uses these instead of its manager's queues: roscpp
/// keeps plain pointers to queues in timers and subscriptions, and on unload the manager may destroy its queues while a
/// callback still keeps the nodelet, and with it timers and subscriptions, alive.
class CallbackThread {
 public:
  /// @param report told what callbacks throw; runs in the thread
  explicit CallbackThread(const FailureReport& report) : report_(report), queue_(report), spinner_(1, &queue_) {}
  CallbackThread(const CallbackThread&) = delete;
  CallbackThread& operator=(const CallbackThread&) = delete;

  /// Subscriptions, services and timers made with the result have their callbacks here.
  ros::NodeHandle Attach(ros::NodeHandle nh) {
    nh.setCallbackQueue(&queue_);
    return nh;
  }

  /// Calls a function again and again, also after it has thrown: roscpp ends a timer whose callback throws.
  ros::WallTimer MakeTimer(const ros::NodeHandle& nh, double period_s, std::function<void()> function) {
    return Attach(nh).createWallTimer(ros::WallDuration(period_s),
                                      [report = report_, function = std::move(function)](const ros::WallTimerEvent&) {
                                        CallGuarded(function, report);
                                      });
  }

  void Start() { spinner_.start(); }

  /// Has a function called in this object's thread, after what was queued before, and does not wait for it.
  void Queue(std::function<void()> function) {
    queue_.Queue([this, function = std::move(function)] { CallGuarded(function, report_); });
  }

  /// Waits for the callback that runs, if any; none runs afterwards, and nobody waits in Call. What is attached must
  /// be gone before this object.
  void Stop() {
    spinner_.stop();
    queue_.disable();
    queue_.clear();
  }

  /// See GuardedQueue. False: Stop was called.
  bool Call(std::function<void()> function) { return queue_.Call(std::move(function)); }
  /// Waits in another thread until all callbacks that were queued before have returned. False: Stop was called.
  bool Drain() {
    return Call([] {});
  }

 private:
  const FailureReport report_;
  GuardedQueue queue_;
  ros::AsyncSpinner spinner_;
};

}  // namespace acmp
