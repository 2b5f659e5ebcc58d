#pragma once

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// Pairs of places that, exchanged in this order where they are out of order, sort any kSize values: Batcher's merge
/// exchange (Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M). Known to the compiler, so that a GPU thread
/// keeps the values in registers.
template <int kSize>
struct SortingNetwork {
  static constexpr int kMaxExchanges = kSize * (kSize - 1) / 2;
  int low[kMaxExchanges > 0 ? kMaxExchanges : 1] = {};
  int high[kMaxExchanges > 0 ? kMaxExchanges : 1] = {};
  int count = 0;

  ACMP_HOST_DEVICE constexpr SortingNetwork() {
    int top = 1;  // largest power of two below kSize
    while (2 * top < kSize) top *= 2;
    for (int p = top; p > 0; p /= 2) {
      int q = top, rest = 0, distance = p;
      for (;;) {
        for (int i = 0; i + distance < kSize; ++i) {
          if ((i & p) != rest) continue;
          low[count] = i;
          high[count] = i + distance;
          ++count;
        }
        if (q == p) break;
        distance = q - p;
        q /= 2;
        rest = p;
      }
    }
  }
};

/// Sorts values that can be compared with each other (no NaN), the smallest first.
template <int kSize>
ACMP_HOST_DEVICE inline void SortValues(float (&values)[kSize]) {
  constexpr SortingNetwork<kSize> network;
  ACMP_UNROLL
  for (int i = 0; i < network.count; ++i) {
    const float a = values[network.low[i]], b = values[network.high[i]];
    values[network.low[i]] = Smaller(a, b);
    values[network.high[i]] = Larger(a, b);
  }
}

}  // namespace acmp
