#include "acmp_mapping/patch_match/window_sums.h"

#include <cstdint>
#include <cstring>

// GNU vectors (gcc and clang, any processor) instead of one processor's intrinsics. Products and sums must not fuse in
// this file (-ffp-contract=off), so that a variant's results do not depend on what its instruction set has.

namespace acmp {
namespace {

typedef float Floats4 __attribute__((vector_size(16)));
typedef int Ints4 __attribute__((vector_size(16)));
typedef int64_t Pairs4 __attribute__((vector_size(16)));  // of floats
typedef float Floats8 __attribute__((vector_size(32)));
typedef int Ints8 __attribute__((vector_size(32)));
typedef int64_t Pairs8 __attribute__((vector_size(32)));

#ifdef __clang__
#define ACMP_SHUFFLE(Floats, a, b, ...) __builtin_shufflevector((Floats)(a), (Floats)(b), __VA_ARGS__)
#else
#define ACMP_SHUFFLE(Floats, a, b, ...) \
  __builtin_shuffle((Floats)(a), (Floats)(b), (decltype((Floats){} < (Floats){})){__VA_ARGS__})
#endif

/// Eight lanes hold the samples in this order, which separating pairs within each half of a register gives.
constexpr int kLaneSamples[8] = {0, 1, 4, 5, 2, 3, 6, 7};
/// The first samples go eight at a time, the last four in order.
constexpr int kWideSamples = kPatchSamples / 8 * 8;
static_assert(kPatchSamples - kWideSamples == 4, "four samples are left");

constexpr int kLanes = kWideSamples + 8;  ///< with those that fill the last eight

/// Offsets from the centre by lane, px.
struct LaneOffsets {
  alignas(32) float col[kLanes];
  alignas(32) float row[kLanes];
};

constexpr LaneOffsets MakeLaneOffsets() {
  LaneOffsets offsets = {};
  for (int lane = 0; lane < kPatchSamples; ++lane) {
    const int sample = lane < kWideSamples ? lane / 8 * 8 + kLaneSamples[lane % 8] : lane;
    offsets.col[lane] = static_cast<float>(WindowCol(sample));
    offsets.row[lane] = static_cast<float>(WindowRow(sample));
  }
  return offsets;
}

constexpr LaneOffsets kLaneOffsets = MakeLaneOffsets();

/// Of each lane's sample: the four texels around it begin at `offset`, and how far it lies between them.
struct WindowCells {
  alignas(32) int offset[kLanes];
  alignas(32) float fx[kLanes];
  alignas(32) float fy[kLanes];
};

inline int64_t LoadPair(const float* pair) {
  int64_t bits;
  memcpy(&bits, pair, sizeof(bits));
  return bits;
}

/// Rounds to the nearest float of the square root.
constexpr float SquareRoot(double x) {
  double root = x;
  for (int i = 0; i < 30; ++i) root = 0.5 * (root + x / root);
  return static_cast<float>(root);
}

/// Of the samples from the centre.
struct SampleDistances {
  alignas(32) float px[kPatchSamples];
};

constexpr SampleDistances MakeSampleDistances() {
  SampleDistances distances = {};
  for (int i = 0; i < kPatchSamples; ++i) {
    distances.px[i] = SquareRoot(WindowCol(i) * WindowCol(i) + WindowRow(i) * WindowRow(i));
  }
  return distances;
}

constexpr SampleDistances kSampleDistances = MakeSampleDistances();

/// The reference's samples.
struct PatchValues {
  alignas(32) float value[kPatchSamples];   ///< grey value minus the centre's; 0 outside the image
  alignas(32) float inside[kPatchSamples];  ///< 1 inside the image, 0 outside
};

inline void LoadValues(const ImageView<const float>& reference, int col, int row, PatchValues* values) {
  const float center = reference(col, row);
  const bool whole = reference.Contains(col - kPatchRadius, row - kPatchRadius) &&
                     reference.Contains(col + kPatchRadius, row + kPatchRadius);
  for (int i = 0; i < kPatchSamples; ++i) {
    const int x = col + WindowCol(i), y = row + WindowRow(i);
    const bool inside = whole || reference.Contains(x, y);
    values->value[i] = inside ? reference(x, y) - center : 0.0f;
    values->inside[i] = inside ? 1.0f : 0.0f;
  }
}

namespace four {
#define ACMP_LANES 4
#define ACMP_LANES_TARGET
#include "window_lanes.inc"
#undef ACMP_LANES
#undef ACMP_LANES_TARGET
}  // namespace four

#ifdef __x86_64__
namespace avx2 {
#define ACMP_LANES 8
#define ACMP_LANES_TARGET __attribute__((target("avx2")))
#include "window_lanes.inc"
#undef ACMP_LANES
#undef ACMP_LANES_TARGET
}  // namespace avx2
#endif

}  // namespace

std::vector<WindowFunctions> SupportedWindowFunctions() {
  std::vector<WindowFunctions> supported = {{"baseline", four::SumWindow, four::LoadPatch}};
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx2")) supported.push_back({"avx2", avx2::SumWindow, avx2::LoadPatch});
#endif
  return supported;
}

}  // namespace acmp
