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
#include "lru_cache.h"
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
    const int number = graph_.Add(random.Below(5), after, [this, caller, i](int thread) {
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
      const bool urgent = random.Below(4) == 0;
      graph->Add(
          pool, after, [=](int thread) { Do(i, pool, thread, after, spin); }, urgent);
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

TEST_F(TaskGraphTest, RandomGraphsKeepTheirOrderWithAnyThreads) {
  for (uint32_t seed = 0; seed < 300; ++seed) {
    TaskGraph graph;
    CheckedGraph checked(seed, &graph);
    graph.Run(checked.threads, interrupt_);
    EXPECT_EQ(checked.errors, 0) << "seed " << seed;
    for (size_t i = 0; i < checked.runs.size(); ++i) EXPECT_EQ(checked.runs[i], 1) << "seed " << seed << ", task " << i;
  }
}

TEST_F(TaskGraphTest, UrgentTasksGoFirst) {
  for (const std::vector<int>& threads : {std::vector<int>{}, {1}}) {
    TaskGraph graph;
    Journal journal;
    graph.Add(0, {}, journal.Writer(0));
    graph.Add(0, {}, journal.Writer(1));
    graph.Add(0, {}, journal.Writer(2), true);
    graph.Add(0, {1}, journal.Writer(3), true);
    graph.Add(0, {}, journal.Writer(4));
    graph.Add(0, {}, journal.Writer(5), true);
    graph.Run(threads, interrupt_);
    EXPECT_THAT(journal.numbers(), ElementsAre(2, 5, 0, 1, 3, 4));
  }
}

TEST_F(TaskGraphTest, AnyTaskOfARandomGraphMayFail) {
  for (uint32_t seed = 0; seed < 200; ++seed) {
    TaskGraph graph;
    CheckedGraph checked(seed, &graph);
    const int count = static_cast<int>(checked.runs.size());
    const int fails_after = TestRandom(seed + 1000).Below(count);
    graph.Add(0, {fails_after}, [](int) { throw ProcessingError("lost"); });
    EXPECT_EQ(FailureOf(&graph, checked.threads, interrupt_), "lost") << "seed " << seed;
    EXPECT_EQ(checked.errors, 0) << "seed " << seed;
    for (const std::atomic<int>& runs : checked.runs) EXPECT_LE(runs, 1) << "seed " << seed;
    EXPECT_EQ(checked.runs[static_cast<size_t>(fails_after)], 1) << "seed " << seed;
  }
}

TEST_F(TaskGraphTest, InterruptionStopsAllThreads) {
  for (const std::vector<int>& threads : {std::vector<int>{}, {1, 1}, {4, 2}}) {
    StopRequest interrupt;
    TaskGraph graph;
    Journal journal;
    graph.Add(0, {}, journal.Writer(0));
    const int last = graph.Add(1, {0}, [&](int) {
      journal.Note(1);
      interrupt.Request();
    });
    graph.Add(0, {last}, journal.Writer(2));
    graph.Add(1, {last}, journal.Writer(3));
    EXPECT_THROW(graph.Run(threads, interrupt), Interrupted);
    EXPECT_THAT(journal.numbers(), ElementsAre(0, 1));
  }
}

TEST(StopRequestTest, ErrorsOfTheWorkAreThrown) {
  StopRequest watcher;
  EXPECT_THROW(watcher.RunCancellable([] { throw std::runtime_error("bad image"); }), std::runtime_error);
  watcher.Check();
  bool ran = false;
  watcher.RunCancellable([&] { ran = true; });
  EXPECT_TRUE(ran) << "an error of the work before stops nothing";
}

TEST(StopRequestTest, ARequestEndsALoopUnderWay) {
  StopRequest watcher;
  std::atomic<int> turns = {0};
  watcher.RunCancellable([&] {
    tbb::parallel_for(0, 1000, [&](int) {
      if (++turns == 1) watcher.Request();
    });
    throw std::runtime_error("what the loop left is no error");
  });
  EXPECT_LT(turns, 1000);
}

TEST(StopRequestTest, AfterARequestNothingBegins) {
  StopRequest watcher;
  watcher.Request();
  watcher.RunCancellable([] { FAIL(); });
  EXPECT_THROW(watcher.Check(), Interrupted);
}

using Cache = LruCache<int, int>;
constexpr size_t kBytes = 4;  // of every value

std::shared_ptr<const int> Make(int value) { return std::make_shared<const int>(value); }

Cache::Pointer Get(Cache* cache, int key, const std::function<Cache::Pointer()>& make) {
  return cache->Get(key, make, [](int) { return kBytes; });
}

/// What the cache has for a key, or -1.
int Peek(Cache* cache, int key) {
  return *Get(cache, key, [] { return Make(-1); });
}

TEST(LruCache, KeepsWhatWasUsedLast) {
  for (const size_t max_bytes : {2 * kBytes, 100 * kBytes}) {
    Cache cache(max_bytes, max_bytes == 2 * kBytes ? 100 : 2);  // either bound counts
    for (const int key : {1, 2, 1, 3}) Get(&cache, key, [key] { return Make(10 * key); });
    EXPECT_EQ(cache.bytes(), 2 * kBytes);
    EXPECT_EQ(Peek(&cache, 1), 10);
    EXPECT_EQ(Peek(&cache, 3), 30);
    EXPECT_EQ(Peek(&cache, 2), -1) << "was used before the others";
  }
}

TEST(LruCache, ValuesAndBytesAreRightWhateverManyThreadsDo) {
  Cache cache(10 * kBytes);
  std::atomic<int> wrong{0}, failed{0};
  std::vector<std::thread> threads;
  for (uint32_t seed = 0; seed < 6; ++seed) {
    threads.emplace_back([&, seed] {
      TestRandom random(seed);
      for (int i = 0; i < 3000; ++i) {
        const int key = random.Below(20);
        const int action = random.Below(10);
        if (action == 0) cache.Drop(key);
        try {
          wrong += *Get(&cache, key, [&] {
            std::this_thread::yield();
            if (action == 1) throw ProcessingError("unreadable");
            return Make(10 * key);
          }) != 10 * key;
        } catch (const ProcessingError&) {
          ++failed;
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(failed, 0);
  EXPECT_LE(cache.bytes(), 10 * kBytes);
  for (int key = 0; key < 20; ++key) cache.Drop(key);
  EXPECT_EQ(cache.bytes(), 0u);
}

}  // namespace
}  // namespace acmp
