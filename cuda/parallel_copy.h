#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>

namespace acmp {

/// `count` elements from page-locked memory, by all threads: a single one is slower than the bus.
template <class T>
void ParallelCopy(const T* from, size_t count, T* to) {
  constexpr size_t kPart = 1 << 16;
  tbb::parallel_for(size_t{0}, (count + kPart - 1) / kPart, [&](size_t part) {
    const size_t begin = part * kPart;
    std::copy(from + begin, from + std::min(count, begin + kPart), to + begin);
  });
}

}  // namespace acmp
