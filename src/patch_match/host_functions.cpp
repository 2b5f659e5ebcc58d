#include "acmp_mapping/patch_match/host_functions.h"

#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

// GNU vectors (gcc and clang, any processor) instead of one processor's intrinsics. Products and sums must not fuse in
// this file (-ffp-contract=off), so that a variant's results do not depend on what its instruction set has. A variant
// is a function for its set, into which all else is compiled (ACMP_PART), with registers of as many lanes as the set
// has.

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

#define ACMP_PART inline ACMP_ALWAYS_INLINE

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

/// Of each lane's sample: the four pixels around it begin at `offset`, and how far it lies between them.
struct WindowCells {
  alignas(32) int offset[kLanes];
  alignas(32) float fx[kLanes];
  alignas(32) float fy[kLanes];
};

ACMP_PART int64_t LoadPair(const float* pair) {
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

/// Places of the samples from the centre, px.
struct SamplePlaces {
  int col[kPatchSamples], row[kPatchSamples];
};

constexpr SamplePlaces MakeSamplePlaces() {
  SamplePlaces places = {};
  for (int i = 0; i < kPatchSamples; ++i) {
    places.col[i] = WindowCol(i);
    places.row[i] = WindowRow(i);
  }
  return places;
}

constexpr SamplePlaces kSamplePlaces = MakeSamplePlaces();

/// The reference's samples.
struct PatchValues {
  alignas(32) float value[kPatchSamples];   ///< grey value minus the centre's; 0 outside the image
  alignas(32) float inside[kPatchSamples];  ///< 1 inside the image, 0 outside
};

ACMP_PART void LoadValues(const ImageView<const float>& reference, int col, int row, PatchValues* values) {
  const float center = reference(col, row);
  const bool whole = reference.Contains(col - kPatchRadius, row - kPatchRadius) &&
                     reference.Contains(col + kPatchRadius, row + kPatchRadius);
  if (whole) {
    const float* middle = &reference(col, row);
    for (int i = 0; i < kPatchSamples; ++i) {
      values->value[i] = middle[kSamplePlaces.row[i] * reference.stride + kSamplePlaces.col[i]] - center;
      values->inside[i] = 1.0f;
    }
    return;
  }
  for (int i = 0; i < kPatchSamples; ++i) {
    const int x = col + kSamplePlaces.col[i], y = row + kSamplePlaces.row[i];
    const bool inside = reference.Contains(x, y);
    values->value[i] = inside ? reference(x, y) - center : 0.0f;
    values->inside[i] = inside ? 1.0f : 0.0f;
  }
}

/// The floats of pairs, as two arrays.
ACMP_PART void Separate(const Pairs4& low, const Pairs4& high, Floats4* first, Floats4* second) {
  *first = ACMP_SHUFFLE(Floats4, low, high, 0, 2, 4, 6);
  *second = ACMP_SHUFFLE(Floats4, low, high, 1, 3, 5, 7);
}
ACMP_PART void Separate(const Pairs8& low, const Pairs8& high, Floats8* first, Floats8* second) {
  *first = ACMP_SHUFFLE(Floats8, low, high, 0, 2, 8, 10, 4, 6, 12, 14);
  *second = ACMP_SHUFFLE(Floats8, low, high, 1, 3, 9, 11, 5, 7, 13, 15);
}

/// Pairs from as many addresses as there are lanes, as two arrays.
ACMP_PART void LoadPairs(const float* base, const int* offset, Floats4* first, Floats4* second) {
  const Pairs4 low = {LoadPair(base + offset[0]), LoadPair(base + offset[1])};
  const Pairs4 high = {LoadPair(base + offset[2]), LoadPair(base + offset[3])};
  Separate(low, high, first, second);
}
ACMP_PART void LoadPairs(const float* base, const int* offset, Floats8* first, Floats8* second) {
  const float* p[8];
  for (int i = 0; i < 8; ++i) p[i] = base + offset[i];
  const Pairs8 low = {LoadPair(p[0]), LoadPair(p[1]), LoadPair(p[4]), LoadPair(p[5])};
  const Pairs8 high = {LoadPair(p[2]), LoadPair(p[3]), LoadPair(p[6]), LoadPair(p[7])};
  Separate(low, high, first, second);
}

/// Eight lanes, in one register or two: the lower four plus the upper ones.
ACMP_PART void AddHalves(const Floats4 (&eight)[2], Floats4* sum) { *sum = eight[0] + eight[1]; }
ACMP_PART void AddHalves(const Floats8 (&eight)[1], Floats4* sum) {
  Floats4 halves[2];
  memcpy(halves, eight, sizeof(halves));
  *sum = halves[0] + halves[1];
}

ACMP_PART float SumLanes(const Floats4& lanes) { return (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]); }

/// Where the samples of the lanes from `lane` on lie in the source image.
template <class Floats, class Ints>
ACMP_PART void FindCells(const ImageView<const float>& image, const PlaneWarp& warp, int lane, WindowCells* cells) {
  // One unit in the last place before the last column and row, so that a cell always has a next one.
  constexpr float kBelowOne = 1.0f - 0x1p-24f;
  const Floats max_x = Floats{} + kBelowOne * static_cast<float>(image.width - 1);
  const Floats max_y = Floats{} + kBelowOne * static_cast<float>(image.height - 1);
  const Floats zero = max_x - max_x;  // not a constant, or gcc makes two instructions of a maximum
  Floats dx, dy;
  memcpy(&dx, kLaneOffsets.col + lane, sizeof(dx));
  memcpy(&dy, kLaneOffsets.row + lane, sizeof(dy));
  const Floats inv_z = 1.0f / (warp.center.z + dx * warp.step_col.z + dy * warp.step_row.z);
  Floats x = (warp.center.x + dx * warp.step_col.x + dy * warp.step_row.x) * inv_z;
  Floats y = (warp.center.y + dx * warp.step_col.y + dy * warp.step_row.y) * inv_z;
  // As Clamp: NaN becomes 0.
  x = x > zero ? x : zero;
  y = y > zero ? y : zero;
  x = x < max_x ? x : max_x;
  y = y < max_y ? y : max_y;
  const Ints x0 = __builtin_convertvector(x, Ints);  // the cell's upper left pixel
  const Ints y0 = __builtin_convertvector(y, Ints);
  const Floats fx = x - __builtin_convertvector(x0, Floats);
  const Floats fy = y - __builtin_convertvector(y0, Floats);
  const Ints offset = y0 * image.stride + x0;
  memcpy(cells->offset + lane, &offset, sizeof(offset));
  memcpy(cells->fx + lane, &fx, sizeof(fx));
  memcpy(cells->fy + lane, &fy, sizeof(fy));
}

/// Adds the samples of the lanes from `lane` on; `a` and `b` are the patch's samples that they begin with.
template <class Floats, class Pairs>
ACMP_PART void AddSamples(const ImageView<const float>& image, const WindowCells& cells, float center, int lane,
                          const PatchSample* a, const PatchSample* b, Floats* ws, Floats* wss, Floats* wrs) {
  Floats upper_left, upper_right, lower_left, lower_right, reference, weight, fx, fy;
  LoadPairs(image.data, cells.offset + lane, &upper_left, &upper_right);
  LoadPairs(image.data + image.stride, cells.offset + lane, &lower_left, &lower_right);
  Pairs low, high;
  memcpy(&low, a, sizeof(low));
  memcpy(&high, b, sizeof(high));
  Separate(low, high, &reference, &weight);
  memcpy(&fx, cells.fx + lane, sizeof(fx));
  memcpy(&fy, cells.fy + lane, sizeof(fy));
  const Floats top = upper_left + fx * (upper_right - upper_left);
  const Floats bottom = lower_left + fx * (lower_right - lower_left);
  const Floats value = top + fy * (bottom - top) - center;
  const Floats weighted = weight * value;
  *ws += weighted;
  *wss += weighted * value;
  *wrs += weighted * reference;
}

template <class Floats, class Ints>
ACMP_PART void FindAllCells(const ImageView<const float>& image, const PlaneWarp& warp, WindowCells* cells) {
  constexpr int kRegisterLanes = sizeof(Floats) / sizeof(float);
  for (int i = 0; i < kPatchSamples; i += kRegisterLanes) FindCells<Floats, Ints>(image, warp, i, cells);
}

/// Lane by lane the same additions in the same order, whatever the registers' width. The next window's cells are found
/// before the samples of a window are read: a processor works on both at once.
/// @tparam Floats,Ints,Pairs registers of 4 or 8 floats, as many integers, and half as many pairs
template <class Floats, class Ints, class Pairs>
ACMP_PART void SumWindowsIn(const ImageView<const float>& image, const PlaneWarp* warps, int count,
                            const ReferencePatch& patch, WindowSums* sums) {
  constexpr int kRegisterLanes = sizeof(Floats) / sizeof(float), kRegisters = 8 / kRegisterLanes;
  const PatchSample* samples = patch.samples;
  WindowCells all_cells[2];
  if (count > 0) FindAllCells<Floats, Ints>(image, warps[0], &all_cells[0]);
  for (int window = 0; window < count; ++window) {
    if (window + 1 < count) FindAllCells<Floats, Ints>(image, warps[window + 1], &all_cells[(window + 1) % 2]);
    const WindowCells& cells = all_cells[window % 2];
    Floats eight[3][kRegisters] = {};
    for (int i = 0; i < kWideSamples; i += 8) {
      for (int k = 0; k < kRegisters; ++k) {
        const PatchSample* first = samples + i + 2 * k;
        AddSamples<Floats, Pairs>(image, cells, patch.center, i + 4 * k, first, first + 4, &eight[0][k], &eight[1][k],
                                  &eight[2][k]);
      }
    }
    Floats4 sum[3];
    for (int k = 0; k < 3; ++k) AddHalves(eight[k], &sum[k]);
    AddSamples<Floats4, Pairs4>(image, cells, patch.center, kWideSamples, samples + kWideSamples,
                                samples + kWideSamples + 2, &sum[0], &sum[1], &sum[2]);
    sums[window] = {SumLanes(sum[0]), SumLanes(sum[1]), SumLanes(sum[2])};
  }
}

/// exp(x) to two units in the last place for -87 <= x <= 0; below, about 1e-38.
template <class Floats, class Ints>
ACMP_PART void Exp(const Floats& exponent, Floats* result) {
  constexpr float kLog2E = 1.44269504f;
  constexpr float kLn2High = 0.693359375f, kLn2Low = -2.12194440e-4f;  // the product with `whole` is exact
  const Floats lowest = Floats{} - 87.0f;
  const Floats x = exponent > lowest ? exponent : lowest;
  const Ints whole = __builtin_convertvector(x * kLog2E - 0.5f, Ints);  // truncation rounds to the nearest: x <= 0
  const Floats n = __builtin_convertvector(whole, Floats);
  const Floats r = x - n * kLn2High - n * kLn2Low;
  Floats sum = 1.0f / 5040 + Floats{};  // Taylor: |r| <= 0.35, so the next term is below 6e-9
  sum = sum * r + 1.0f / 720;
  sum = sum * r + 1.0f / 120;
  sum = sum * r + 1.0f / 24;
  sum = sum * r + 1.0f / 6;
  sum = sum * r + 0.5f;
  sum = sum * r + 1.0f;
  sum = sum * r + 1.0f;
  *result = sum * (Floats)((whole + 127) << 23);  // 2^whole, by its bits
}

/// Weights of the values from `i` on, and their share of the patch's sums.
template <class Floats, class Ints>
ACMP_PART void WeighSamples(const PatchValues& values, float inv_spatial, float inv_color, int i, float* weights,
                            Floats* sum_w, Floats* sum_wr, Floats* sum_wrr) {
  Floats value, inside, distance, weight;
  memcpy(&value, values.value + i, sizeof(value));
  memcpy(&inside, values.inside + i, sizeof(inside));
  memcpy(&distance, kSampleDistances.px + i, sizeof(distance));
  const Floats difference = value < 0.0f ? -value : value;
  Exp<Floats, Ints>(-distance * inv_spatial - difference * inv_color, &weight);
  weight *= inside;
  memcpy(weights + i, &weight, sizeof(weight));
  *sum_w += weight;
  *sum_wr += weight * value;
  *sum_wrr += weight * value * value;
}

template <class Floats, class Ints>
ACMP_PART void LoadPatchIn(const ImageView<const float>& reference, int col, int row, float inv_spatial,
                           float inv_color, ReferencePatch* patch) {
  constexpr int kRegisterLanes = sizeof(Floats) / sizeof(float), kRegisters = 8 / kRegisterLanes;
  PatchValues values;
  LoadValues(reference, col, row, &values);
  alignas(32) float weights[kPatchSamples];
  Floats eight[3][kRegisters] = {};
  for (int i = 0; i < kWideSamples; i += kRegisterLanes) {
    const int k = i / kRegisterLanes % kRegisters;
    WeighSamples<Floats, Ints>(values, inv_spatial, inv_color, i, weights, &eight[0][k], &eight[1][k], &eight[2][k]);
  }
  Floats4 sum[3];
  for (int k = 0; k < 3; ++k) AddHalves(eight[k], &sum[k]);
  WeighSamples<Floats4, Ints4>(values, inv_spatial, inv_color, kWideSamples, weights, &sum[0], &sum[1], &sum[2]);
  for (int i = 0; i < kPatchSamples; ++i) patch->samples[i] = {values.value[i], weights[i]};
  patch->center = reference(col, row);
  SetMoments(SumLanes(sum[0]), SumLanes(sum[1]), SumLanes(sum[2]), patch);
}

/// @tparam kFar whether of the far regions
template <bool kFar, int... kMembers>
ACMP_PART void FindBest(const float* cost, int stride, std::integer_sequence<int, kMembers...>, Ints4* best) {
  Floats4 least = {};
  const auto compare = [&](int member, int along, int across) ACMP_ALWAYS_INLINE {
    const int up_down = along * stride, rows_across = across * stride;
    const Floats4 of_member = {cost[across - up_down], cost[across + up_down], cost[rows_across - along],
                               cost[rows_across + along]};
    if (member == 0) least = of_member;
    *best = of_member < least ? Ints4{} + member : *best;
    least = of_member < least ? of_member : least;
  };
  (compare(kMembers, std::integral_constant<int, StepsAlong(kFar, kMembers)>::value,
           std::integral_constant<int, StepsAcross(kFar, kMembers)>::value),
   ...);
}

/// Median filter of as many pixels as a register has lanes, every second one of a row.
template <class Floats, class Pairs>
ACMP_PART void FilterMediansIn(const RayGrid& rays, float depth_min, float depth_max, int col, int row,
                               const ImageView<PlaneHypothesis>& planes) {
  constexpr int kRegisterLanes = sizeof(Floats) / sizeof(float);
  constexpr MedianOffsets offsets;
  constexpr int kWords = sizeof(PlaneHypothesis) / sizeof(float);
  int lane_offset[kRegisterLanes];
  Floats lane_col;
  for (int lane = 0; lane < kRegisterLanes; ++lane) {
    lane_offset[lane] = 2 * kWords * lane;
    lane_col[lane] = static_cast<float>(col + 2 * lane);
  }
  const auto load = [&](int from_col, int from_row, Floats* nx, Floats* ny, Floats* nz, Floats* d) ACMP_ALWAYS_INLINE {
    const float* first = &planes(from_col, from_row).nx;
    LoadPairs(first, lane_offset, nx, ny);
    LoadPairs(first + 2, lane_offset, nz, d);
  };
  const Floats ray_x = (lane_col - rays.cx) * rays.inv_fx;
  const float ray_y = (static_cast<float>(row) - rays.cy) * rays.inv_fy;
  Floats own[kMedianPixels], extended[kMedianPixels];
  for (int i = 0; i < kMedianPixels; ++i) {
    Floats nx, ny, nz, d;
    load(col + offsets.col[i], row + offsets.row[i], &nx, &ny, &nz, &d);
    const Floats x = (lane_col + static_cast<float>(offsets.col[i]) - rays.cx) * rays.inv_fx;
    const float y = (static_cast<float>(row + offsets.row[i]) - rays.cy) * rays.inv_fy;
    own[i] = -d / (nx * x + ny * y + nz);
    const Floats depth = -d / (nx * ray_x + ny * ray_y + nz);
    const Floats from_min = depth >= depth_min ? depth : Floats{} + kBeyondRange;
    extended[i] = depth <= depth_max ? from_min : Floats{} + kBeyondRange;
  }
  DepthStatistics<Floats> depths, slopes;
  FindStatistics(own, &depths);
  FindStatistics(extended, &slopes);
  const Floats spread_or_none = slopes.median < kBeyondRange ? slopes.spread : depths.spread;
  const Floats depth = spread_or_none < depths.spread ? slopes.median : depths.median;
  Floats nx, ny, nz, d;
  load(col, row, &nx, &ny, &nz, &d);
  d = -depth * (nx * ray_x + ny * ray_y + nz);
  for (int lane = 0; lane < kRegisterLanes; ++lane) planes(col + 2 * lane, row).d = d[lane];
}

template <class Floats, class Ints>
ACMP_PART void FindConfidencesIn(const float* costs, uint32_t views, int num_views, int count,
                                 const ConfidenceRule& rule, float* confidence) {
  constexpr int kRegisterLanes = sizeof(Floats) / sizeof(float);
  for (int first = 0; first < num_views; first += kRegisterLanes) {
    Floats sum = {}, good = {}, bad = {};
    for (int i = 0; i < count; ++i) {
      Floats cost, exponential;
      memcpy(&cost, costs + i * num_views + first, sizeof(cost));
      Exp<Floats, Ints>(-cost * cost * rule.inv_sigma, &exponential);
      sum += cost < rule.good ? exponential : Floats{};
      good += cost < rule.good ? Floats{} + 1.0f : Floats{};
      bad += cost > kBadCost ? Floats{} + 1.0f : Floats{};
    }
    const float decisive = static_cast<float>(rule.decisive);
    const Floats decided = good >= decisive ? sum / good : Floats{} + rule.undecided;
    const Floats result = bad >= decisive ? Floats{} : decided;
    for (int view = first; view < num_views && view < first + kRegisterLanes; ++view) {
      confidence[view] = (views >> view & 1u) != 0 ? result[view - first] : 0.0f;
    }
  }
}

#ifdef __x86_64__
#define ACMP_AVX2 __attribute__((target("avx2")))

ACMP_AVX2 void SumWindowsByAvx2(const ImageView<const float>& image, const PlaneWarp* warps, int count,
                                const ReferencePatch& patch, WindowSums* sums) {
  SumWindowsIn<Floats8, Ints8, Pairs8>(image, warps, count, patch, sums);
}

ACMP_AVX2 void LoadPatchByAvx2(const ImageView<const float>& reference, int col, int row, float inv_spatial,
                               float inv_color, ReferencePatch* patch) {
  LoadPatchIn<Floats8, Ints8>(reference, col, row, inv_spatial, inv_color, patch);
}

ACMP_AVX2 void FilterMediansByAvx2(const RayGrid& rays, float depth_min, float depth_max, int col, int row,
                                   const ImageView<PlaneHypothesis>& planes) {
  FilterMediansIn<Floats8, Pairs8>(rays, depth_min, depth_max, col, row, planes);
}

ACMP_AVX2 void FindConfidencesByAvx2(const float* costs, uint32_t views, int num_views, int count,
                                     const ConfidenceRule& rule, float* confidence) {
  FindConfidencesIn<Floats8, Ints8>(costs, views, num_views, count, rule, confidence);
}
#endif

}  // namespace

void FindBestOfRegions(const float* cost, int stride, bool is_far, int (&best)[kDirections]) {
  Ints4 members = {};
  if (is_far) {
    FindBest<true>(cost, stride, std::make_integer_sequence<int, RegionSize(true)>(), &members);
  } else {
    FindBest<false>(cost, stride, std::make_integer_sequence<int, RegionSize(false)>(), &members);
  }
  memcpy(best, &members, sizeof(best));
}

std::vector<HostFunctions> SupportedHostFunctions() {
  std::vector<HostFunctions> supported = {{"baseline", 4, SumWindowsIn<Floats4, Ints4, Pairs4>,
                                           LoadPatchIn<Floats4, Ints4>, FilterMediansIn<Floats4, Pairs4>,
                                           FindConfidencesIn<Floats4, Ints4>}};
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx2")) {
    supported.push_back({"avx2", 8, SumWindowsByAvx2, LoadPatchByAvx2, FilterMediansByAvx2, FindConfidencesByAvx2});
  }
#endif
  return supported;
}

}  // namespace acmp
