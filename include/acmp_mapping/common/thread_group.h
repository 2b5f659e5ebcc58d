#pragma once

#include <cstdint>

#include "acmp_mapping/common/host_device.h"

namespace acmp {

/// The threads that share the work on one pixel or one cell, with memory that all of them see. The CPU has one, which
/// does all; a GPU several of one warp (WarpGroup), of which each takes every kSize-th part. Functions that take a
/// group are called by all its threads with the same arguments. A group has what its work asks for:
///   kSize                 how many threads there are
///   Rank()                0 .. kSize - 1
///   Sync()                what any wrote before is read by all after
///   Increment(counter)    by several at once
///   Sum(x), Least(x), Greatest(x), Any(x), Union(bits)   of all threads' values, for all of them
///   FromFirst(x)          the value of the first thread, for all of them
///   AddUp(sums), Best(choice)   leave all of them with the sums of what each has summed, the best of what each found
///   kWindowThreads        how many threads, neighbours in rank, compare one window together
///   SumOverWindow(x)      of these, for all of them
/// This is the group of one.
struct SingleThread {
  static constexpr int kSize = 1;
  static constexpr int kWindowThreads = 1;
  ACMP_HOST_DEVICE int Rank() const { return 0; }
  ACMP_HOST_DEVICE void Sync() const {}
  ACMP_HOST_DEVICE void Increment(int* counter) const { ++*counter; }
  ACMP_HOST_DEVICE float Sum(float x) const { return x; }
  template <class T>
  ACMP_HOST_DEVICE T Least(T x) const {
    return x;
  }
  ACMP_HOST_DEVICE float Greatest(float x) const { return x; }
  ACMP_HOST_DEVICE bool Any(bool x) const { return x; }
  ACMP_HOST_DEVICE uint32_t Union(uint32_t bits) const { return bits; }
  ACMP_HOST_DEVICE float FromFirst(float x) const { return x; }
  template <class Sums>
  ACMP_HOST_DEVICE void AddUp(Sums*) const {}
  template <class Choice>
  ACMP_HOST_DEVICE void Best(Choice*) const {}
  ACMP_HOST_DEVICE float SumOverWindow(float x) const { return x; }
};

/// function(i) for all i below `count`, shared out over the group. No synchronisation.
template <class Group, class Function>
ACMP_HOST_DEVICE inline void ForEach(const Group& group, int count, const Function& function) {
  for (int i = group.Rank(); i < count; i += Group::kSize) function(i);
}

/// function(i, j) for all i below `count_i` and j below `count_j`, shared out over the group; neighbouring threads
/// mostly get the same j, so that they read the same source image. No synchronisation.
template <class Group, class Function>
ACMP_HOST_DEVICE inline void ForEachPair(const Group& group, int count_i, int count_j, const Function& function) {
  if (count_i <= 0) return;
  int i = group.Rank(), j = 0;
  for (;; i += Group::kSize) {
    for (; i >= count_i; i -= count_i) ++j;
    if (j >= count_j) return;
    function(i, j);
  }
}

}  // namespace acmp
