#include "acmp_mapping/common/sorting_network.h"

#include <algorithm>

#include "gtest/gtest.h"

namespace acmp {
namespace {

/// A network sorts everything if it sorts all sequences of zeros and ones (the 0-1 principle).
template <int kSize>
void SortAllZerosAndOnes() {
  for (unsigned bits = 0; bits < 1u << kSize; ++bits) {
    float values[kSize];
    for (int i = 0; i < kSize; ++i) values[i] = static_cast<float>(bits >> i & 1u);
    const auto ones = std::count(values, values + kSize, 1.0f);
    SortValues(values);
    ASSERT_TRUE(std::is_sorted(values, values + kSize)) << kSize << " values, bits " << bits;
    ASSERT_EQ(std::count(values, values + kSize, 1.0f), ones) << kSize << " values, bits " << bits;
  }
}

TEST(SortingNetworkTest, SortsAllZerosAndOnes) {
  SortAllZerosAndOnes<1>();
  SortAllZerosAndOnes<2>();
  SortAllZerosAndOnes<3>();
  SortAllZerosAndOnes<7>();
  SortAllZerosAndOnes<16>();
  SortAllZerosAndOnes<21>();
}

TEST(SortingNetworkTest, HasAsManyExchangesAsBatchers) {
  EXPECT_EQ(SortingNetwork<1>().count, 0);
  EXPECT_EQ(SortingNetwork<2>().count, 1);
  EXPECT_EQ(SortingNetwork<4>().count, 5);
  EXPECT_EQ(SortingNetwork<8>().count, 19);
  EXPECT_EQ(SortingNetwork<16>().count, 63);
}

TEST(SortingNetworkTest, SortsEqualAndNegativeValues) {
  float values[] = {3, -1, 3, 0, -1e30f, 1e30f, 0};
  SortValues(values);
  const float expected[] = {-1e30f, -1, 0, 0, 3, 3, 1e30f};
  EXPECT_TRUE(std::equal(values, values + 7, expected));
}

}  // namespace
}  // namespace acmp
