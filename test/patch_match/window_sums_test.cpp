#include "acmp_mapping/patch_match/window_sums.h"

#include <cstdint>
#include <cstring>
#include <limits>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"

namespace acmp {
namespace {

float Real(TestRandom* random, double low, double high) { return static_cast<float>((*random)(low, high)); }

/// Warps into, across the border of and past an image.
PlaneWarp RandomWarp(int width, int height, TestRandom* random) {
  return {{Real(random, -5, width + 5), Real(random, -5, height + 5), 1.0f},
          {Real(random, -1, 1), Real(random, -1, 1), Real(random, -0.05, 0.05)},
          {Real(random, -1, 1), Real(random, -1, 1), Real(random, -0.05, 0.05)}};
}

ReferencePatch RandomPatch(TestRandom* random) {
  ReferencePatch patch = {};
  for (PatchSample& sample : patch.samples) sample = {Real(random, -100, 100), Real(random, 0, 1)};
  patch.center = Real(random, 0, 255);
  return patch;
}

/// Equal bit by bit: not 0 and -0.
bool SameBits(float a, float b) {
  uint32_t bits[2];
  std::memcpy(&bits[0], &a, sizeof(a));
  std::memcpy(&bits[1], &b, sizeof(b));
  return bits[0] == bits[1];
}

bool SameBits(const WindowSums& a, const WindowSums& b) {
  return SameBits(a.ws, b.ws) && SameBits(a.wss, b.wss) && SameBits(a.wrs, b.wrs);
}

bool SameBits(const ReferencePatch& a, const ReferencePatch& b) {
  for (int i = 0; i < kPatchSamples; ++i) {
    const PatchSample &left = a.samples[i], &right = b.samples[i];
    if (!SameBits(left.value, right.value) || !SameBits(left.weight, right.weight)) return false;
  }
  return SameBits(a.center, b.center) && SameBits(a.inv_sum_weight, b.inv_sum_weight) && SameBits(a.mean, b.mean) &&
         SameBits(a.variance, b.variance);
}

const std::vector<std::pair<int, int>> kSizes = {{1, 1}, {1, 8}, {8, 1}, {2, 2}, {2, 9}, {3, 3}, {11, 11}, {31, 23}};

TEST(WindowSumsTest, AreTheSameBitsOnEveryInstructionSet) {
  const std::vector<WindowFunctions> sets = SupportedWindowFunctions();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (const auto& [width, height] : kSizes) {
    if (width < 2 || height < 2) continue;
    const GrayImage padded = RandomImage(width + 3, height + 2, 1);
    const ImageView<const float> image = {&padded(2, 1), width, height, width + 3};
    TestRandom random(2);
    for (int i = 0; i < 1000; ++i) {
      PlaneWarp warp = RandomWarp(width, height, &random);
      if (i % 10 == 9) warp.center.x = i % 20 == 9 ? kInf : kNan;
      const ReferencePatch patch = RandomPatch(&random);
      const WindowSums expected = sets[0].sum_window(image, warp, patch);
      for (const WindowFunctions& set : sets) {
        ASSERT_TRUE(SameBits(set.sum_window(image, warp, patch), expected)) << set.instructions << ", window " << i;
      }
    }
  }
}

TEST(CpuPatchTest, IsTheSameBitsOnEveryInstructionSet) {
  const std::vector<WindowFunctions> sets = SupportedWindowFunctions();
  for (const auto& [width, height] : kSizes) {
    const std::vector<PlanarView> views = RandomViews(2, width, height, 6);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    const ImageView<const float> gray = views[0].gray.View();
    const auto patch_of = [&](const WindowFunctions& set, int col, int row) {
      ReferencePatch patch;
      LoadReferencePatch(state.ContextWith(CpuSampler{{gray, &gray}, set}), col, row, state.options().sigma_color,
                         SingleThread(), &patch);
      return patch;
    };
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        for (const WindowFunctions& set : sets) {
          ASSERT_TRUE(SameBits(patch_of(set, col, row), patch_of(sets[0], col, row)))
              << set.instructions << ": " << col << ", " << row;
        }
      }
    }
  }
}

}  // namespace
}  // namespace acmp
