#include "acmp_mapping/common/random.h"

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

}  // namespace
}  // namespace acmp
