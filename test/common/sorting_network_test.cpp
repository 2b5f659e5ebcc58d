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

}  // namespace
}  // namespace acmp
