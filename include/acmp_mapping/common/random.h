#pragma once

#include <cstdint>

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// Mixes a 32-bit word: the PCG-RXS-M-XS output permutation over one LCG step (O'Neill, HMC-CS-2014-0905; recommended
/// for GPU hashing by Jarzynski and Olano, JCGT 9(3), 2020).
ACMP_HOST_DEVICE inline uint32_t HashWord(uint32_t x) {
  const uint32_t state = x * 747796405u + 2891336453u;
  const uint32_t word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
  return (word >> 22u) ^ word;
}

/// Counter-based random numbers: the n-th draw is a pure function of (seed, pixel, step, n), so nothing is stored per
/// pixel, the order of pixels does not matter and CPU and GPU draw the same stream.
class RandomStream {
 public:
  /// @param pixel linear pixel index; @param step number of the pass and iteration
  ACMP_HOST_DEVICE RandomStream(uint32_t seed, uint32_t pixel, uint32_t step)
      : key_(HashWord(HashWord(HashWord(seed) + pixel) + step)) {}

  ACMP_HOST_DEVICE uint32_t NextWord() { return HashWord(key_ + 0x9e3779b9u * counter_++); }

  /// Uniform in [0, 1); 24 random bits, exact in float.
  ACMP_HOST_DEVICE float NextUniform() { return static_cast<float>(NextWord() >> 8) * 0x1p-24f; }

  /// Goes on as if `count` words had been drawn.
  ACMP_HOST_DEVICE void Skip(uint32_t count) { counter_ += count; }

  /// Uniform in [low, high].
  ACMP_HOST_DEVICE float NextUniform(float low, float high) { return low + NextUniform() * (high - low); }

 private:
  uint32_t key_;
  uint32_t counter_ = 0;
};

}  // namespace acmp
