#include "acmp_mapping/ros/callback_thread.h"

#include <atomic>
#include <chrono>
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

TEST(DrainCallbacks, ReturnsWhenAllThatWasQueuedIsDone) {
  ros::CallbackQueue queue;
  std::atomic<int> done{0};
  for (int i = 0; i < 20; ++i) {
    queue.addCallback(boost::make_shared<Callback>([&done] {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      ++done;
    }));
  }
  std::atomic<bool> stop{false};
  std::thread caller([&] {
    while (!stop) queue.callAvailable(ros::WallDuration(0.01));
  });
  EXPECT_TRUE(DrainCallbacks(&queue));
  EXPECT_EQ(done, 20);
  stop = true;
  caller.join();
}

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

TEST(CallGuarded, AlsoGoesOnWhereThereIsNoMemoryForTheReport) {
  CallGuarded([] { throw std::runtime_error("first"); }, [](const std::string&) { throw std::bad_alloc(); });
}

}  // namespace
}  // namespace acmp
