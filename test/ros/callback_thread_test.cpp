#include "acmp_mapping/ros/callback_thread.h"

#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace acmp {
namespace {

class Callback : public ros::CallbackInterface {
 public:
  explicit Callback(std::function<void()> work) : work_(std::move(work)) {}
  CallResult call() override {
    work_();
    return Success;
  }

 private:
  std::function<void()> work_;
};

TEST(DrainCallbacks, EndsWithTheQueue) {
  ros::CallbackQueue queue;  // nobody calls what is in it
  std::thread waiting([&queue] { EXPECT_FALSE(DrainCallbacks(&queue)); });
  // Whether it has begun to wait by now or not, it must return.
  queue.disable();
  queue.clear();
  waiting.join();
  EXPECT_FALSE(DrainCallbacks(&queue)) << "nor after that";
}

TEST(GuardedQueue, TellsWhatCallbacksThrowAndGoesOn) {
  std::vector<std::string> told;
  GuardedQueue queue([&told](const std::string& text) { told.push_back(text); });
  const auto add = [&queue](std::function<void()> work) { queue.addCallback(boost::make_shared<Callback>(work), 0); };
  add([] { throw std::runtime_error("Time is out of dual 32-bit range"); });
  add([] { throw XmlRpc::XmlRpcException("type error"); });
  add([] { throw std::bad_alloc(); });
  add([] { throw 1; });
  bool went_on = false;
  add([&went_on] { went_on = true; });
  queue.callAvailable();
  EXPECT_TRUE(went_on);
  EXPECT_TRUE(queue.isEmpty()) << "none is called again";
  EXPECT_THAT(told, ::testing::ElementsAre("Time is out of dual 32-bit range", "type error", "out of memory",
                                           "an exception that says nothing"));
}

}  // namespace
}  // namespace acmp
