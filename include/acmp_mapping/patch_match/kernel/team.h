#pragma once

#include <cstdint>

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// The threads that work on one pixel together, with memory that all of them see. A team has
///   kSize                 how many there are, at most the square of kWindowThreads
///   kWindowThreads        how many of them, neighbours in rank, compare one window together
///   Rank()                0 .. kSize - 1
///   Sync()                what any wrote before is read by all after
///   Increment(counter)    by several at once
///   SumOverWindow(value)  over the kWindowThreads neighbours, for all of them
///   SumOverTeam(value)    over all, for all of them
///   Any(value)            whether it is true for any, for all of them
///   Union(mask)           bits that any has set, for all of them
/// Functions that take a team are called by all its threads with the same arguments. This is the team of one.
struct SingleThread {
  static constexpr int kSize = 1;
  static constexpr int kWindowThreads = 1;
  ACMP_HOST_DEVICE int Rank() const { return 0; }
  ACMP_HOST_DEVICE void Sync() const {}
  ACMP_HOST_DEVICE void Increment(int* counter) const { ++*counter; }
  ACMP_HOST_DEVICE float SumOverWindow(float value) const { return value; }
  ACMP_HOST_DEVICE float SumOverTeam(float value) const { return value; }
  ACMP_HOST_DEVICE bool Any(bool value) const { return value; }
  ACMP_HOST_DEVICE uint32_t Union(uint32_t mask) const { return mask; }
};

/// function(i) for all i below `count`, shared out over the team. No synchronisation.
template <class Team, class Function>
ACMP_HOST_DEVICE inline void ForEach(const Team& team, int count, const Function& function) {
  for (int i = team.Rank(); i < count; i += Team::kSize) function(i);
}

/// function(i, j) for all i below `count_i` and j below `count_j`, shared out over the team; neighbouring threads
/// mostly get the same j, so that they read the same source image. No synchronisation.
template <class Team, class Function>
ACMP_HOST_DEVICE inline void ForEachPair(const Team& team, int count_i, int count_j, const Function& function) {
  if (count_i <= 0) return;
  int i = team.Rank(), j = 0;
  for (;; i += Team::kSize) {
    for (; i >= count_i; i -= count_i) ++j;
    if (j >= count_j) return;
    function(i, j);
  }
}

}  // namespace acmp
