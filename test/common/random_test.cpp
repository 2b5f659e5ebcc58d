#include "acmp_mapping/common/random.h"

#include <cmath>
#include <functional>
#include <set>
#include <vector>

#include "gtest/gtest.h"

namespace acmp {
namespace {

// Values of an independent implementation in arbitrary-precision integers: they pin the stream, so that stored results
// stay comparable and CPU and GPU can be held to the same numbers.
TEST(RandomTest, HashHasKnownValues) {
  EXPECT_EQ(HashWord(0u), 129708002u);
  EXPECT_EQ(HashWord(1u), 2831084092u);
  EXPECT_EQ(HashWord(2u), 2055130248u);
  EXPECT_EQ(HashWord(12345u), 4099845390u);
  EXPECT_EQ(HashWord(0xffffffffu), 3861530882u);
}

TEST(RandomTest, StreamHasKnownValues) {
  RandomStream first(1, 0, 0);
  EXPECT_EQ(first.NextWord(), 555269243u);
  EXPECT_EQ(first.NextWord(), 4080352806u);
  EXPECT_EQ(first.NextWord(), 1472237078u);
  RandomStream second(7, 19200, 65);
  EXPECT_EQ(second.NextWord(), 716031048u);
  EXPECT_EQ(second.NextWord(), 425445013u);
  EXPECT_EQ(second.NextWord(), 2047818685u);
}

TEST(RandomTest, UniformIsTheWordsUpper24Bits) {
  RandomStream words(3, 4, 5), values(3, 4, 5);
  for (int i = 0; i < 1000; ++i) {
    const double expected = (words.NextWord() >> 8) / 16777216.0;
    const float value = values.NextUniform();
    ASSERT_EQ(value, expected);  // 24 bits fit a float exactly
    ASSERT_LT(value, 1.0f);
  }
}

/// Pearson's statistic of counts against equal expectations.
double ChiSquare(const std::vector<int>& counts) {
  double total = 0;
  for (const int count : counts) total += count;
  const double expected = total / static_cast<double>(counts.size());
  double sum = 0;
  for (const int count : counts) sum += (count - expected) * (count - expected) / expected;
  return sum;
}

/// Mean + 5 standard deviations of a chi-square variable: exceeded by chance about once in 10^5 (its tail is heavier
/// than a normal one); the streams are fixed, so the tests do not flicker.
double ChiSquareLimit(size_t cells) {
  const double freedom = static_cast<double>(cells) - 1;
  return freedom + 5 * std::sqrt(2 * freedom);
}

constexpr int kDraws = 200000;

/// A sequence of draws that ought to look independent: number i of 0..kDraws-1.
struct Sequence {
  const char* name;
  std::function<float(int)> draw;
};

std::vector<Sequence> Sequences() {
  return {
      {"along one stream",
       [](int i) {
         static RandomStream stream(1, 77, 0);
         if (i == 0) stream = RandomStream(1, 77, 0);
         return stream.NextUniform();
       }},
      {"over pixels", [](int i) { return RandomStream(1, static_cast<uint32_t>(i), 1).NextUniform(); }},
      {"over steps", [](int i) { return RandomStream(1, 99, static_cast<uint32_t>(i)).NextUniform(); }},
      {"over seeds", [](int i) { return RandomStream(static_cast<uint32_t>(i), 99, 1).NextUniform(); }},
      {"third draw over pixels",
       [](int i) {
         RandomStream stream(5, static_cast<uint32_t>(i), 66);
         stream.NextUniform();
         stream.NextUniform();
         return stream.NextUniform();
       }},
  };
}

TEST(RandomTest, DrawsAreUniform) {
  for (const Sequence& sequence : Sequences()) {
    std::vector<int> counts(64);
    for (int i = 0; i < kDraws; ++i) ++counts[static_cast<size_t>(sequence.draw(i) * 64)];
    EXPECT_LT(ChiSquare(counts), ChiSquareLimit(counts.size())) << sequence.name;
  }
}

TEST(RandomTest, ConsecutiveDrawsAreIndependent) {
  // Joint histogram of each draw and the one before: uniform over the 16 x 16 cells only if both are independent.
  for (const Sequence& sequence : Sequences()) {
    std::vector<int> counts(256);
    float last = sequence.draw(0);
    for (int i = 1; i < kDraws; ++i) {
      const float value = sequence.draw(i);
      ++counts[static_cast<size_t>(last * 16) * 16 + static_cast<size_t>(value * 16)];
      last = value;
    }
    EXPECT_LT(ChiSquare(counts), ChiSquareLimit(counts.size())) << sequence.name;
  }
}

TEST(RandomTest, NeighbouringPixelsAreIndependentDrawByDraw) {
  constexpr int kWidth = 640;
  for (const uint32_t offset : {1, kWidth, kWidth + 1}) {
    std::vector<int> counts(256);
    for (uint32_t pixel = 0; pixel < 50000; ++pixel) {
      RandomStream a(1, pixel, 2), b(1, pixel + offset, 2);
      for (int draw = 0; draw < 4; ++draw) {
        ++counts[static_cast<size_t>(a.NextUniform() * 16) * 16 + static_cast<size_t>(b.NextUniform() * 16)];
      }
    }
    EXPECT_LT(ChiSquare(counts), ChiSquareLimit(counts.size())) << "offset " << offset;
  }
}

}  // namespace
}  // namespace acmp
