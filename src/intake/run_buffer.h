#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <optional>

#include "acmp_mapping/intake/time_jump_tracker.h"

namespace acmp {

constexpr int64_t kSameExposureNs = 1000000;  ///< rounding of stamps stays far below, the shortest frame interval above
constexpr size_t kMoreThanImages = 10;        ///< clouds, masks, depth: those of images that are still to come

/// Distance of a received pose, mask or depth map from a stamp.
template <class Received>
int64_t Gap(const Received& received, int64_t stamp_ns) {
  return std::llabs(received.sample.stamp_ns - stamp_ns);
}

/// Leaves what belongs to the run whose first image has this stamp.
template <class Received>
void KeepNewRun(int64_t first_image_ns, TimeJumpTracker* runs, std::deque<Received>* buffer) {
  const std::optional<uint64_t> first = runs->StartRun(first_image_ns);
  const auto is_old = [&first](const Received& received) { return !first || received.arrival < *first; };
  buffer->erase(std::remove_if(buffer->begin(), buffer->end(), is_old), buffer->end());
}

}  // namespace acmp
