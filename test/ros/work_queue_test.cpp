#include "acmp_mapping/ros/work_queue.h"

#include <memory>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/ros/callback_thread.h"

namespace acmp {
namespace {

/// Its clock stands unless a test moves it.
struct Queue : WorkQueue<int, std::shared_ptr<int>> {
  explicit Queue(OverloadPolicy policy) : WorkQueue(policy, 100, [this] { return now_s; }) {}
  std::optional<int> Push(int input, bool must_wait = false) { return WorkQueue::Push(input, 40, must_wait); }
  double now_s = 100;
};

int PopInput(Queue* queue, bool overtaken = false) {
  const auto item = queue->Pop();
  EXPECT_EQ(item->overtaken, overtaken) << item->input.value();
  return item->input.value();
}

constexpr double kLong = 1.1 * kLongestWaitS;

TEST(WorkQueue, AStallLosesNothing) {
  Queue queue(OverloadPolicy::kDrop);
  const int count = static_cast<int>(kWaitingInputs + kInputGroup);
  for (int i = 0; i < count; ++i) EXPECT_FALSE(queue.Push(i));
  queue.now_s += 0.9 * kLongestWaitS;
  for (int i = 0; i < count; ++i) EXPECT_EQ(PopInput(&queue), i);
}

TEST(WorkQueue, WhatHasWaitedLongIsOvertakenAfterAGroupOfNeighbours) {
  Queue queue(OverloadPolicy::kDrop);
  queue.Push(0);
  EXPECT_EQ(PopInput(&queue), 0);
  for (int i = 1; i < 7; ++i) queue.Push(i);
  queue.now_s += kLong;
  for (int i : {1, 2, 3}) EXPECT_EQ(PopInput(&queue), i) << "with 0 a group of " << kInputGroup;
  for (int i : {4, 5}) EXPECT_EQ(PopInput(&queue, true), i) << "in their order";
  queue.Push(7);
  EXPECT_EQ(PopInput(&queue, true), 6);
  queue.now_s += 0.5 * kLongestWaitS;
  EXPECT_EQ(PopInput(&queue), 7) << "the next group";
}

TEST(WorkQueue, OfTooManyTheOldestAfterTheGroupGo) {
  Queue queue(OverloadPolicy::kDrop);
  queue.Push(0);
  EXPECT_EQ(PopInput(&queue), 0);
  const int kept = 1 + static_cast<int>(kWaitingInputs + kInputGroup);
  for (int i = 1; i < kept; ++i) EXPECT_FALSE(queue.Push(i));
  EXPECT_EQ(queue.Push(kept), 4) << "1 to 3 belong to the group of 0";
  EXPECT_EQ(queue.Push(kept + 1), 5);
  EXPECT_EQ(queue.waiting_inputs(), kWaitingInputs + kInputGroup);
}

TEST(WorkQueue, AnIdleItemWhereNothingComes) {
  Queue queue(OverloadPolicy::kDrop);
  EXPECT_TRUE(queue.Pop(0.001)->is_idle());
  queue.Push(1);
  EXPECT_EQ(queue.Pop(0.001)->input, 1);
}

TEST(WorkQueue, SkipIfBusyTakesOnlyWhenIdle) {
  Queue queue(OverloadPolicy::kSkipIfBusy);
  queue.Push(1);
  queue.Push(2);
  EXPECT_EQ(PopInput(&queue), 1);
  queue.Push(3);
  for (int i : {2, 3}) EXPECT_EQ(PopInput(&queue, true), i) << "one was worked on";
  queue.PushCommand(nullptr);
  EXPECT_FALSE(queue.Pop()->input);
  queue.Push(4);
  EXPECT_EQ(PopInput(&queue, true), 4) << "a command is work as well";
}

TEST(WorkQueue, BlockTakesWhatFitsIntoMemoryAndSoDoesAnyPolicyWhenAskedTo) {
  for (const OverloadPolicy policy : {OverloadPolicy::kBlock, OverloadPolicy::kDrop, OverloadPolicy::kSkipIfBusy}) {
    const bool asked = policy != OverloadPolicy::kBlock;
    Queue queue(policy);
    queue.now_s = 0;
    EXPECT_FALSE(queue.Push(1, asked));
    EXPECT_FALSE(queue.Push(2, asked));
    EXPECT_EQ(queue.Push(3, asked), 3) << "120 of 100 bytes; nobody waits, whom a reset would have to wake";
    EXPECT_EQ(PopInput(&queue), 1);
    queue.now_s += kLong;
    EXPECT_FALSE(queue.Push(4, asked));
    EXPECT_EQ(queue.ClearInputs(), (std::deque<int>{2, 4})) << "all that came before";
    EXPECT_FALSE(queue.WorkQueue::Push(5, 1000, asked)) << "one always may";
    EXPECT_EQ(queue.Push(6, asked), 6);
    EXPECT_EQ(PopInput(&queue), 5);
  }
}

TEST(WorkQueue, CommandsKeepTheirPlaceOrComeFirstAndAreNeverDropped) {
  Queue queue(OverloadPolicy::kSkipIfBusy);
  const auto pop_command = [&queue] { return **queue.Pop()->command; };
  queue.PushCommand(std::make_shared<int>(10));
  queue.Push(1);
  queue.PushCommand(std::make_shared<int>(20));
  queue.PushCommand(std::make_shared<int>(30), true);
  queue.Push(2);
  EXPECT_EQ(pop_command(), 30) << "urgent";
  EXPECT_EQ(pop_command(), 10);
  EXPECT_EQ(queue.ClearInputs(), (std::deque<int>{1, 2})) << "2 was overtaken";
  EXPECT_EQ(queue.waiting_inputs(), 0u);
  EXPECT_EQ(pop_command(), 20);
}

TEST(WorkQueue, StopWakesEverybodyAndDiscards) {
  Queue queue(OverloadPolicy::kBlock);
  queue.Push(1);
  auto command = std::make_shared<int>(10);
  const std::weak_ptr<int> watch = command;
  queue.PushCommand(std::move(command));
  queue.Push(2);
  queue.Stop();
  EXPECT_EQ(queue.Push(3), 3);
  EXPECT_TRUE(watch.expired()) << "who waits for a command must learn that it will not run";
  EXPECT_FALSE(queue.Pop());
  EXPECT_FALSE(queue.PushCommand(nullptr));

  Queue idle(OverloadPolicy::kBlock);
  std::thread worker([&] { EXPECT_FALSE(idle.Pop()); });
  idle.Stop();
  worker.join();
}

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

TEST(GuardedQueue, NobodyWaitsOnceItIsDisabled) {
  GuardedQueue queue([](const std::string&) {});  // nobody calls what is in it
  std::thread waiting([&queue] { EXPECT_FALSE(queue.Call([] {})); });
  queue.disable();  // whether it has begun to wait by now or not, it must return
  queue.clear();
  waiting.join();
  EXPECT_FALSE(queue.Call([] {})) << "nor after that";
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
