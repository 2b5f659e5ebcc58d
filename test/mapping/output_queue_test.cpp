#include "mapper_outputs.h"

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

using testing::ElementsAre;

TEST(OutputQueueTest, WithoutAThreadRunsJobsAtOnce) {
  OutputQueue queue(false);
  int done = 0;
  queue.Submit([&] { done = 1; });
  EXPECT_EQ(done, 1);
  queue.Submit([&] { done = 2; });
  EXPECT_EQ(done, 2);
  queue.WaitForAll();
  EXPECT_THROW(queue.Submit([] { throw std::runtime_error("job"); }), std::runtime_error);
}

TEST(OutputQueueTest, RunsJobsInTheirOrderInOneOtherThread) {
  OutputQueue queue(true);
  std::vector<int> order;
  std::thread::id thread;
  for (int i = 0; i < 100; ++i) {
    queue.Submit([&, i] {
      order.push_back(i);
      thread = std::this_thread::get_id();
    });
  }
  queue.WaitForAll();
  ASSERT_EQ(order.size(), 100u);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(order[static_cast<size_t>(i)], i);
  EXPECT_NE(thread, std::this_thread::get_id());
}

TEST(OutputQueueTest, SubmitWaitsWhileTooManyAreNotDone) {
  std::promise<void> open;
  const std::shared_future<void> opened = open.get_future().share();
  OutputQueue queue(true);
  for (size_t i = 1; i < OutputQueue::kMaxJobs; ++i) queue.Submit([opened] { opened.wait(); });
  std::atomic<bool> has_returned{false};
  bool had_returned_when_opened = true;
  std::thread opener([&] {
    // Long enough for a Submit that does not wait; one that does passes however slow the machine is.
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    had_returned_when_opened = has_returned;
    open.set_value();
  });
  queue.Submit([opened] { opened.wait(); });
  has_returned = true;
  opener.join();
  EXPECT_FALSE(had_returned_when_opened);
}

TEST(OutputQueueTest, WhatAJobThrowsComesOutOnceAndTheOthersRun) {
  OutputQueue queue(true);
  std::vector<int> done;
  queue.Submit([] { throw std::runtime_error("job"); });
  EXPECT_THROW(queue.WaitForAll(), std::runtime_error);
  queue.Submit([&] { done.push_back(2); });
  queue.WaitForAll();
  EXPECT_THAT(done, ElementsAre(2));
}

TEST(OutputQueueTest, DestructionWaitsForTheJobUnderWayAndThrowsAwayTheRest) {
  std::promise<void> begun, open;
  const std::shared_future<void> opened = open.get_future().share();
  bool first = false, second = false;
  {
    OutputQueue queue(true);
    queue.Submit([&, opened] {
      begun.set_value();
      opened.wait();
      first = true;
    });
    // The first job goes on once the second is thrown away.
    const auto opens_when_gone = [&open](void*) { open.set_value(); };
    queue.Submit([&second, gate = std::shared_ptr<void>(nullptr, opens_when_gone)] { second = true; });
    begun.get_future().wait();
  }
  EXPECT_TRUE(first);
  EXPECT_FALSE(second);
}

}  // namespace
}  // namespace acmp
