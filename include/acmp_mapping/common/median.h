#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace acmp {

/// Of values that are not empty and none of which is NaN; of an even number the larger of the two in the middle. O(n).
template <class T>
T Median(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace acmp
