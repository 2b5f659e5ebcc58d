#include "lru_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "support/random_views.h"

namespace acmp {
namespace {

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

/// A value that takes until Finish to be made, by a thread of its own.
class SlowValue {
 public:
  /// Returns when it is being made.
  SlowValue(Cache* cache, int key, int value) {
    thread_ = std::thread([this, cache, key, value] {
      value_ = Get(cache, key, [&] {
        begun_.set_value();
        finish_.get_future().wait();
        return Make(value);
      });
    });
    begun_.get_future().wait();
  }
  ~SlowValue() {
    if (thread_.joinable()) Finish();
  }
  SlowValue(const SlowValue&) = delete;
  SlowValue& operator=(const SlowValue&) = delete;

  Cache::Pointer Finish() {
    finish_.set_value();
    thread_.join();
    return value_;
  }

 private:
  std::promise<void> begun_, finish_;
  Cache::Pointer value_;
  std::thread thread_;
};

TEST(LruCache, EvictionNeverDropsAValueThatIsBeingMade) {
  Cache cache(2 * kBytes);
  SlowValue slow(&cache, 1, 7);
  for (int key = 2; key < 20; ++key) Peek(&cache, key);
  EXPECT_EQ(cache.bytes(), 2 * kBytes);
  slow.Finish();
  EXPECT_EQ(cache.bytes(), 2 * kBytes);
}

TEST(LruCache, AValueDroppedWhileItIsMadeIsHandedOutButNotKept) {
  Cache cache(100);
  SlowValue dropped(&cache, 1, 7);
  cache.Drop(1);
  SlowValue later(&cache, 1, 8);
  EXPECT_EQ(*dropped.Finish(), 7);
  EXPECT_EQ(cache.bytes(), 0u) << "the later one is not there yet";
  later.Finish();
  EXPECT_EQ(Peek(&cache, 1), 8);
  cache.Drop(1);
  EXPECT_EQ(cache.bytes(), 0u);
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
