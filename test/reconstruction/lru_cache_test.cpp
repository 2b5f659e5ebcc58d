#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <map>
#include <mutex>
#include <sstream>
#include <thread>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "reconstruct_lru_cache.h"
#include "reconstruct_progress.h"
#include "support/random_views.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

class LruCacheTest : public ::testing::Test {
 protected:
  int Get(int key) {
    return *cache_.Get(
        key,
        [&] {
          ++made_;
          return std::make_shared<const int>(10 * key);
        },
        [](int) { return size_t{4}; });
  }
  LruCache<int, int> cache_{8};
  int made_ = 0;
};

TEST_F(LruCacheTest, KeepsWhatWasUsedLast) {
  EXPECT_EQ(Get(1), 10);
  EXPECT_EQ(Get(2), 20);
  EXPECT_EQ(Get(1), 10);
  EXPECT_EQ(made_, 2);
  EXPECT_EQ(Get(3), 30);  // drops 2
  EXPECT_EQ(Get(1), 10);
  EXPECT_EQ(made_, 3);
  EXPECT_EQ(Get(2), 20);
  EXPECT_EQ(made_, 4);
  EXPECT_EQ(cache_.bytes(), 8u);
}

TEST_F(LruCacheTest, TooLargeValuesAreHandedOutButNotKept) {
  LruCache<int, int> tiny(3);
  const auto value = tiny.Get(
      1, [] { return std::make_shared<const int>(5); }, [](int) { return size_t{4}; });
  EXPECT_EQ(*value, 5);
  EXPECT_EQ(tiny.size(), 0u);
  EXPECT_EQ(tiny.bytes(), 0u);
}

/// A key that counts the threads that have compared it with others. The cache compares while it holds its mutex: from
/// then on the thread waits for what is being made, if anything is.
struct WatchedKey {
  int value;
  friend bool operator<(const WatchedKey& a, const WatchedKey& b) {
    thread_local bool counted = false;
    if (!counted) ++threads;
    counted = true;
    return a.value < b.value;
  }
  static inline std::atomic<int> threads{0};
};

using WatchedCache = LruCache<WatchedKey, int>;

/// A value that takes until Finish to be made, by a thread of its own.
class SlowValue {
 public:
  /// Returns when it is being made. `make` is called in the end.
  SlowValue(WatchedCache* cache, int key, const std::function<WatchedCache::Pointer()>& make) {
    thread_ = std::thread([this, cache, key, make] {
      try {
        value_ = cache->Get(
            {key},
            [&] {
              begun_.set_value();
              finish_.get_future().wait();
              return make();
            },
            [](int) { return size_t{4}; });
      } catch (const std::exception& error) {
        failure_ = error.what();
      }
    });
    begun_.get_future().wait();
  }
  ~SlowValue() {
    if (thread_.joinable()) Finish();
  }
  SlowValue(const SlowValue&) = delete;
  SlowValue& operator=(const SlowValue&) = delete;

  void Finish() {
    finish_.set_value();
    thread_.join();
  }
  WatchedCache::Pointer value() const { return value_; }
  std::string failure() const { return failure_; }

 private:
  std::promise<void> begun_, finish_;
  WatchedCache::Pointer value_;
  std::string failure_;
  std::thread thread_;
};

/// Gets a value from several threads that all wait for it when the constructor returns, if it is being made.
class Waiters {
 public:
  static constexpr int kCount = 6;

  Waiters(WatchedCache* cache, int key) {
    const int before = WatchedKey::threads;
    for (int i = 0; i < kCount; ++i) {
      threads_.emplace_back([this, cache, key] {
        std::string failure;
        WatchedCache::Pointer value;
        try {
          value = cache->Get(
              {key},
              [&] {
                ++made_;
                return std::make_shared<const int>(-1);
              },
              [](int) { return size_t{4}; });
        } catch (const std::exception& error) {
          failure = error.what();
        }
        const std::lock_guard<std::mutex> lock(mutex_);
        values.push_back(value);
        failures.push_back(failure);
      });
    }
    while (WatchedKey::threads < before + kCount) std::this_thread::yield();
  }
  /// Returns how many had to make the value themselves.
  int Join() {
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
    return made_;
  }

  std::vector<WatchedCache::Pointer> values;
  std::vector<std::string> failures;

 private:
  std::mutex mutex_;
  std::atomic<int> made_{0};
  std::vector<std::thread> threads_;
};

std::shared_ptr<const int> MakeSeven() { return std::make_shared<const int>(7); }
std::shared_ptr<const int> FailToMake() { throw ProcessingError("unreadable"); }

/// What the cache has for a key, or -1.
int Peek(WatchedCache* cache, int key) {
  return *cache->Get(
      {key}, [] { return std::make_shared<const int>(-1); }, [](int) { return size_t{4}; });
}

TEST(LruCacheThreads, AValueThatManyWantIsMadeOnce) {
  WatchedCache cache(100);
  SlowValue slow(&cache, 1, MakeSeven);
  Waiters waiters(&cache, 1);
  slow.Finish();
  EXPECT_EQ(waiters.Join(), 0);
  ASSERT_NE(slow.value(), nullptr);
  EXPECT_EQ(waiters.values, std::vector<WatchedCache::Pointer>(Waiters::kCount, slow.value()));
  EXPECT_EQ(cache.bytes(), 4u);
}

TEST(LruCacheThreads, DifferentValuesAreMadeAtTheSameTime) {
  WatchedCache cache(100);
  SlowValue first(&cache, 1, MakeSeven), second(&cache, 2, MakeSeven);  // both are being made
  EXPECT_EQ(Peek(&cache, 3), -1) << "a third meanwhile";
  second.Finish();
  first.Finish();
  EXPECT_EQ(cache.size(), 3u);
  EXPECT_EQ(cache.bytes(), 12u);
}

TEST(LruCacheThreads, AFailureReachesAllWhoWaitAndTheNextTriesAgain) {
  WatchedCache cache(100);
  SlowValue slow(&cache, 1, FailToMake);
  Waiters waiters(&cache, 1);
  slow.Finish();
  EXPECT_EQ(waiters.Join(), 0);
  EXPECT_EQ(slow.failure(), "unreadable");
  EXPECT_EQ(waiters.failures, std::vector<std::string>(Waiters::kCount, "unreadable"));
  EXPECT_EQ(cache.size(), 0u);
  EXPECT_EQ(cache.bytes(), 0u);
  EXPECT_EQ(Peek(&cache, 1), -1) << "made anew";
  EXPECT_EQ(cache.bytes(), 4u);
}

TEST(LruCacheThreads, WhoIsToldOfAFailureFindsNothingLeftOfIt) {
  WatchedCache cache(100);
  SlowValue slow(&cache, 1, FailToMake);
  const int before = WatchedKey::threads;
  int again = 0;
  std::thread waiter([&] {
    EXPECT_THROW(Peek(&cache, 1), ProcessingError);
    again = Peek(&cache, 1);
  });
  while (WatchedKey::threads == before) std::this_thread::yield();
  slow.Finish();
  waiter.join();
  EXPECT_EQ(again, -1);
}

TEST(LruCacheThreads, EvictionNeverDropsAValueThatIsBeingMade) {
  WatchedCache cache(8);
  SlowValue slow(&cache, 1, MakeSeven);
  for (int key = 2; key < 20; ++key) Peek(&cache, key);
  EXPECT_EQ(cache.size(), 3u) << "two that are made";
  EXPECT_EQ(cache.bytes(), 8u);
  Waiters waiters(&cache, 1);
  slow.Finish();
  EXPECT_EQ(waiters.Join(), 0) << "made once";
  EXPECT_EQ(waiters.values, std::vector<WatchedCache::Pointer>(Waiters::kCount, slow.value()));
  EXPECT_EQ(cache.size(), 2u);
  EXPECT_EQ(cache.bytes(), 8u);
  EXPECT_EQ(Peek(&cache, 1), 7) << "used last";
}

TEST(LruCacheThreads, ADroppedValueStillGoesToThoseWhoWait) {
  WatchedCache cache(100);
  SlowValue slow(&cache, 1, MakeSeven);
  Waiters waiters(&cache, 1);
  cache.Drop({1});
  slow.Finish();
  EXPECT_EQ(waiters.Join(), 0);
  EXPECT_EQ(waiters.values, std::vector<WatchedCache::Pointer>(Waiters::kCount, slow.value()));
  EXPECT_EQ(cache.size(), 0u);
  EXPECT_EQ(cache.bytes(), 0u);
}

TEST(LruCacheThreads, AFailureLeavesALaterValueOfTheKeyAlone) {
  WatchedCache cache(100);
  SlowValue slow(&cache, 1, FailToMake);
  cache.Drop({1});
  EXPECT_EQ(Peek(&cache, 1), -1);
  slow.Finish();
  EXPECT_EQ(slow.failure(), "unreadable");
  EXPECT_EQ(cache.size(), 1u);
  EXPECT_EQ(cache.bytes(), 4u);
}

TEST(LruCacheThreads, AValueDroppedMeanwhileIsNotCountedForALaterOne) {
  WatchedCache cache(100);
  SlowValue dropped(&cache, 1, MakeSeven);
  cache.Drop({1});
  SlowValue later(&cache, 1, MakeSeven);
  dropped.Finish();
  EXPECT_EQ(cache.bytes(), 0u) << "the later one is not there yet";
  EXPECT_EQ(cache.size(), 1u);
  later.Finish();
  EXPECT_EQ(cache.bytes(), 4u);
  cache.Drop({1});
  EXPECT_EQ(cache.bytes(), 0u);
}

TEST(LruCacheThreads, BytesAreThoseOfTheValuesWhateverHappens) {
  LruCache<int, int> cache(40);
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
          const auto make = [&] {
            std::this_thread::yield();
            if (action == 1) throw ProcessingError("unreadable");
            return std::make_shared<const int>(10 * key);
          };
          const int value = *cache.Get(key, make, [](int) { return size_t{4}; });
          wrong += value == 10 * key ? 0 : 1;
        } catch (const ProcessingError&) {
          ++failed;
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(failed, 0);
  EXPECT_LE(cache.bytes(), 40u);
  EXPECT_EQ(cache.bytes(), 4 * cache.size());
}

TEST(Progress, TimeLeftFollowsTheCostAndIgnoresReusedSteps) {
  std::ostringstream stream;
  Progress progress(&stream, ProgressStyle::kSilent, 10.0);
  EXPECT_LT(progress.SecondsLeft(1), 0);
  progress.Begin("first", 4, 1.0);
  progress.Step(true);
  progress.Step(true);
  EXPECT_LT(progress.SecondsLeft(1), 0) << "reused steps say nothing about the speed";
  progress.Step();
  progress.Step();
  EXPECT_DOUBLE_EQ(progress.done_share(), 0.4);
  EXPECT_DOUBLE_EQ(progress.SecondsLeft(3), 3.0 / 2 * 6);
  EXPECT_EQ(stream.str(), "");
}

TEST(Progress, LinesOncePerPercent) {
  std::ostringstream stream;
  Progress progress(&stream, ProgressStyle::kLines, 1000.0);
  progress.Begin("many", 1000, 1.0);
  for (int i = 0; i < 1000; ++i) progress.Step();
  const std::string text = stream.str();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 101);
  EXPECT_THAT(text, HasSubstr("100 %  many 1000/1000"));
}

TEST(Progress, BarIsErasedForMessagesAndAtTheEnd) {
  std::ostringstream stream;
  {
    Progress progress(&stream, ProgressStyle::kBar, 2.0);
    progress.Begin("stage", 2, 1.0);
    progress.Step();
    progress.Warn("look");
  }
  EXPECT_THAT(stream.str(), HasSubstr("[###############...............] 50 %  stage 1/2"));
  EXPECT_THAT(stream.str(), HasSubstr("\r\033[Kwarning: look\n"));
}

TEST(Progress, SilentStyleStillWarns) {
  std::ostringstream stream;
  Progress progress(&stream, ProgressStyle::kSilent, 2.0);
  progress.Note("hello");
  progress.Warn("look");
  EXPECT_EQ(stream.str(), "warning: look\n");
}

TEST(FormatDuration, UsesHoursOnlyWhenNeeded) {
  EXPECT_EQ(FormatDuration(3.6), "0:04");
  EXPECT_EQ(FormatDuration(127), "2:07");
  EXPECT_EQ(FormatDuration(3909), "1:05:09");
  EXPECT_EQ(FormatDuration(-5), "0:00");
}

}  // namespace
}  // namespace acmp
