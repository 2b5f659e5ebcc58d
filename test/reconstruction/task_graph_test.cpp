#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/stop_request.h"
#include "gtest/gtest.h"
#include "support/random_views.h"
#include "task_graph.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;

std::string FailureOf(TaskGraph* graph, const std::vector<int>& threads, const StopRequest& interrupt) {
  try {
    graph->Run(threads, interrupt);
  } catch (const std::exception& error) {
    return error.what();
  } catch (const Interrupted&) {
    return "interrupted";
  }
  return "";
}

/// Notes who ran, in order.
class Journal {
 public:
  std::function<void(int)> Writer(int number) {
    return [this, number](int) { Note(number); };
  }
  void Note(int number) {
    const std::lock_guard<std::mutex> lock(mutex_);
    numbers_.push_back(number);
  }
  std::vector<int> numbers() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return numbers_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<int> numbers_;
};

class TaskGraphTest : public ::testing::Test {
 protected:
  StopRequest interrupt_;
  Journal journal_;
  TaskGraph graph_;
};

TEST_F(TaskGraphTest, WithoutThreadsTheCallerDoesAllInOrder) {
  TestRandom random(1);
  const std::thread::id caller = std::this_thread::get_id();
  for (int i = 0; i < 100; ++i) {
    std::vector<int> after;
    for (int k = random.Below(4); k > 0 && i > 0; --k) after.push_back(random.Below(i));
    const int number = graph_.Add(random.Below(5), 0, after, [this, caller, i](int thread) {
      EXPECT_EQ(std::this_thread::get_id(), caller);
      EXPECT_EQ(thread, 0);
      journal_.Note(i);
    });
    EXPECT_EQ(number, i);
  }
  graph_.Run({}, interrupt_);
  std::vector<int> all(100);
  std::iota(all.begin(), all.end(), 0);
  EXPECT_EQ(journal_.numbers(), all);
}

/// A graph whose tasks check that what they wait for is done, that a thread does one at a time, and that it is of their
/// pool.
class CheckedGraph {
 public:
  CheckedGraph(uint32_t seed, TaskGraph* graph) {
    TestRandom random(seed);
    threads.resize(1 + static_cast<size_t>(random.Below(kMost)));
    for (int& count : threads) count = 1 + random.Below(kMost);
    busy_ = std::vector<std::atomic<bool>>(kMost * threads.size());
    const int size = 1 + random.Below(80);
    runs = std::vector<std::atomic<int>>(static_cast<size_t>(size));
    const double most = random(0, 6);
    for (int i = 0; i < size; ++i) {
      std::vector<int> after;
      for (int k = static_cast<int>(random(0, most)); k > 0 && i > 0; --k) after.push_back(random.Below(i));
      const int pool = random.Below(static_cast<int>(threads.size()));
      const int spin = random.Below(3) == 0 ? 2000 : 0;
      const int rank = random.Below(4);
      graph->Add(pool, rank, after, [=](int thread) { Do(i, pool, thread, after, spin); });
    }
  }

  std::vector<int> threads;
  std::vector<std::atomic<int>> runs;  ///< of each task
  std::atomic<int> errors{0};

 private:
  static constexpr int kMost = 4;  ///< pools, and threads of a pool

  void Do(int number, int pool, int thread, const std::vector<int>& after, int spin) {
    if (thread < 0 || thread >= threads[static_cast<size_t>(pool)]) {
      ++errors;
      return;
    }
    std::atomic<bool>& busy = busy_[kMost * static_cast<size_t>(pool) + static_cast<size_t>(thread)];
    if (busy.exchange(true)) ++errors;
    for (const int other : after) errors += runs[static_cast<size_t>(other)] == 1 ? 0 : 1;
    for (int i = 0; i < spin; ++i) std::atomic_signal_fence(std::memory_order_seq_cst);
    busy = false;
    ++runs[static_cast<size_t>(number)];
  }

  std::vector<std::atomic<bool>> busy_;  ///< per pool and thread
};

TEST_F(TaskGraphTest, RandomGraphsKeepTheirOrderWithAnyThreadsAlsoWhereATaskFails) {
  for (uint32_t seed = 0; seed < 400; ++seed) {
    SCOPED_TRACE(seed);
    TaskGraph graph;
    CheckedGraph checked(seed, &graph);
    const bool fails = seed % 2 == 1;
    const int before = TestRandom(seed + 1000).Below(static_cast<int>(checked.runs.size()));
    if (fails) graph.Add(0, 0, {before}, [](int) { throw ProcessingError("lost"); });
    EXPECT_EQ(FailureOf(&graph, checked.threads, interrupt_), fails ? "lost" : "");
    EXPECT_EQ(checked.errors, 0);
    EXPECT_EQ(checked.runs[static_cast<size_t>(before)], 1);
    for (const std::atomic<int>& runs : checked.runs) EXPECT_TRUE(runs == 1 || (fails && runs == 0));
  }
}

TEST_F(TaskGraphTest, TheLeastRankGoesFirst) {
  for (const std::vector<int>& threads : {std::vector<int>{}, {1}}) {
    TaskGraph graph;
    Journal journal;
    graph.Add(0, 0, {}, journal.Writer(0));
    graph.Add(0, 0, {}, journal.Writer(1));
    graph.Add(0, -1, {}, journal.Writer(2));
    graph.Add(0, -2, {1}, journal.Writer(3));
    graph.Add(0, 0, {}, journal.Writer(4));
    graph.Add(0, -1, {}, journal.Writer(5));
    graph.Run(threads, interrupt_);
    EXPECT_THAT(journal.numbers(), ElementsAre(2, 5, 0, 1, 3, 4));
  }
}

TEST_F(TaskGraphTest, InterruptionStopsAllThreads) {
  for (const std::vector<int>& threads : {std::vector<int>{}, {1, 1}, {4, 2}}) {
    StopRequest interrupt;
    TaskGraph graph;
    Journal journal;
    graph.Add(0, 0, {}, journal.Writer(0));
    const int last = graph.Add(1, 0, {0}, [&](int) {
      journal.Note(1);
      interrupt.Request();
    });
    graph.Add(0, 0, {last}, journal.Writer(2));
    graph.Add(1, 0, {last}, journal.Writer(3));
    EXPECT_THROW(graph.Run(threads, interrupt), Interrupted);
    EXPECT_THAT(journal.numbers(), ElementsAre(0, 1));
  }
}

}  // namespace
}  // namespace acmp
