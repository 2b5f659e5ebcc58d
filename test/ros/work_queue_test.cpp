#include "acmp_mapping/ros/work_queue.h"

#include <memory>
#include <thread>

#include <gtest/gtest.h>

namespace acmp {
namespace {

using Queue = WorkQueue<int, std::shared_ptr<int>>;

int PopInput(Queue* queue) { return std::get<0>(*queue->Pop()); }

TEST(WorkQueue, DropOldestKeepsTheNewestTwo) {
  Queue queue(OverloadPolicy::kDropOldest);
  EXPECT_FALSE(queue.Push(1));
  EXPECT_FALSE(queue.Push(2));
  EXPECT_EQ(queue.Push(3), 1);
  EXPECT_EQ(queue.waiting_inputs(), 2u);
  EXPECT_EQ(PopInput(&queue), 2);
  EXPECT_EQ(PopInput(&queue), 3);
}

TEST(WorkQueue, SkipIfBusyTakesOnlyWhenIdle) {
  Queue queue(OverloadPolicy::kSkipIfBusy);
  EXPECT_FALSE(queue.Push(1));
  EXPECT_EQ(queue.Push(2), 2) << "one waits";
  EXPECT_EQ(PopInput(&queue), 1);
  EXPECT_EQ(queue.Push(3), 3) << "one is worked on";
  queue.PushCommand(nullptr);
  EXPECT_EQ(queue.Pop()->index(), 1u);  // the worker asks for more: 1 is done
  EXPECT_EQ(queue.Push(4), 4) << "a command is work as well";
}

TEST(WorkQueue, BlockWaitsForRoom) {
  Queue queue(OverloadPolicy::kBlock);
  queue.Push(1);
  queue.Push(2);
  std::thread pusher([&] { EXPECT_FALSE(queue.Push(3)); });
  EXPECT_EQ(PopInput(&queue), 1);
  pusher.join();  // hangs if nobody wakes it
  EXPECT_EQ(PopInput(&queue), 2);
  EXPECT_EQ(PopInput(&queue), 3);
}

TEST(WorkQueue, AnyPolicyWaitsForRoomWhenAskedTo) {
  for (const OverloadPolicy policy : {OverloadPolicy::kDropOldest, OverloadPolicy::kSkipIfBusy}) {
    Queue queue(policy);
    EXPECT_FALSE(queue.Push(1, true));
    EXPECT_FALSE(queue.Push(2, true));
    std::thread pusher([&] { EXPECT_FALSE(queue.Push(3, true)); });
    EXPECT_EQ(PopInput(&queue), 1);
    pusher.join();  // hangs if nobody wakes it
    EXPECT_EQ(PopInput(&queue), 2);
    EXPECT_EQ(PopInput(&queue), 3);
  }
}

TEST(WorkQueue, CommandsKeepTheirPlaceAndAreNeverDropped) {
  Queue queue(OverloadPolicy::kDropOldest);
  queue.PushCommand(std::make_shared<int>(10));
  queue.Push(1);
  queue.PushCommand(std::make_shared<int>(20));
  queue.Push(2);
  EXPECT_EQ(queue.Push(3), 1);
  EXPECT_EQ(*std::get<1>(*queue.Pop()), 10);
  EXPECT_EQ(*std::get<1>(*queue.Pop()), 20);
  EXPECT_EQ(PopInput(&queue), 2);
  EXPECT_EQ(PopInput(&queue), 3);
}

TEST(WorkQueue, UrgentCommandsComeFirst) {
  Queue queue(OverloadPolicy::kBlock);
  for (const int input : {1, 2}) queue.Push(input);
  queue.PushCommand(std::make_shared<int>(10));
  queue.PushUrgent(std::make_shared<int>(20));
  queue.PushUrgent(std::make_shared<int>(21));
  EXPECT_EQ(*std::get<1>(*queue.Pop()), 20);
  EXPECT_EQ(*std::get<1>(*queue.Pop()), 21);
  EXPECT_EQ(PopInput(&queue), 1);
  queue.PushUrgent(std::make_shared<int>(22));
  EXPECT_EQ(*std::get<1>(*queue.Pop()), 22);
  queue.Stop();
  EXPECT_FALSE(queue.PushUrgent(nullptr));
}

TEST(WorkQueue, ClearInputsLeavesCommands) {
  Queue queue(OverloadPolicy::kDropOldest);
  queue.Push(1);
  queue.PushCommand(std::make_shared<int>(10));
  queue.Push(2);
  const auto cleared = queue.ClearInputs();
  EXPECT_EQ(cleared, (std::deque<int>{1, 2}));
  EXPECT_EQ(queue.waiting_inputs(), 0u);
  EXPECT_EQ(queue.Pop()->index(), 1u);
}

TEST(WorkQueue, StopWakesEverybodyAndDiscards) {
  Queue queue(OverloadPolicy::kBlock);
  queue.Push(1);
  auto command = std::make_shared<int>(10);
  const std::weak_ptr<int> watch = command;
  queue.PushCommand(std::move(command));
  queue.Push(2);
  std::thread pusher([&] { EXPECT_EQ(queue.Push(3), 3); });
  queue.Stop();
  pusher.join();
  EXPECT_TRUE(watch.expired()) << "who waits for a command must learn that it will not run";
  EXPECT_FALSE(queue.Pop());
  EXPECT_FALSE(queue.PushCommand(nullptr));

  Queue idle(OverloadPolicy::kBlock);
  std::thread worker([&] { EXPECT_FALSE(idle.Pop()); });
  idle.Stop();
  worker.join();
}

}  // namespace
}  // namespace acmp
