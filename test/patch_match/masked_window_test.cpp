#include "acmp_mapping/patch_match/kernel/photometric_cost.h"

#include <cmath>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/window_sums.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr DepthRange kRange = {1, 10};

/// Random views with masks of a few blocks.
struct MaskedViews {
  explicit MaskedViews(uint32_t seed)
      : views(RandomViews(4, 61, 47, seed)), problem(MakeProblem(views, 0, kRange, true)) {
    TestRandom random(seed);
    for (const PlanarView& view : views) {
      Mask mask(view.camera.width, view.camera.height, 255);
      for (int block = 0; block < 2; ++block) {
        const int left = random.Below(mask.width() - 4), top = random.Below(mask.height() - 3);
        for (int row = top; row < top + 3; ++row) {
          for (int col = left; col < left + 4; ++col) mask(col, row) = 0;
        }
      }
      clearances.push_back(MakeClearance(mask));
      masks.push_back(std::move(mask));
    }
    problem.reference.clearance = clearances[0].View();
    for (size_t i = 0; i < problem.sources.size(); ++i) problem.sources[i].clearance = clearances[i + 1].View();
  }

  std::vector<PlanarView> views;
  std::vector<Mask> masks;
  std::vector<ClearanceMap> clearances;
  PatchMatchProblem problem;
};

/// Whether a position is interpolated with a pixel that the mask ignores.
bool IsMixed(const Mask& mask, const Eigen::Vector2d& position) {
  const double x = std::clamp(position.x(), 0.0, mask.width() - 1.0);
  const double y = std::clamp(position.y(), 0.0, mask.height() - 1.0);
  for (const double col : {std::floor(x), std::ceil(x)}) {
    for (const double row : {std::floor(y), std::ceil(y)}) {
      if (mask(static_cast<int>(col), static_cast<int>(row)) == 0) return true;
    }
  }
  return false;
}

/// Greatest distance of an ignored pixel from the window's middle along an axis, over how far its samples reach.
double DistanceOverReach(const Mask& mask, const Eigen::Vector2d& middle, double reach) {
  double nearest = 1e9;
  for (int row = 0; row < mask.height(); ++row) {
    for (int col = 0; col < mask.width(); ++col) {
      if (mask(col, row) != 0) continue;
      nearest = std::min(nearest, std::max(std::abs(col - middle.x()), std::abs(row - middle.y())));
    }
  }
  return nearest - reach;
}

TEST(MaskedWindowTest, NoWindowWithASampleOfAnIgnoredPixelIsComparedAndFewOthersAreNot) {
  int with_ignored = 0, clear = 0, needlessly = 0;
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    MaskedViews made(seed);
    KernelState state(made.problem);
    const auto context = state.Context();
    TestRandom random(seed + 50);
    for (int trial = 0; trial < 3000; ++trial) {
      const int col = random.Below(61), row = random.Below(47), view = random.Below(3);
      const PlaneHypothesis plane = RandomHypothesis(made.views[0].camera, col, row, 2, 6, 70, &random);
      const PlaneWarp warp = MakePlaneWarp(context.sources[view], PlaneDual(context, plane), static_cast<float>(col),
                                           static_cast<float>(row));
      const MatchView& source = made.problem.sources[static_cast<size_t>(view)];
      const Mask& mask = made.masks[static_cast<size_t>(view) + 1];
      bool is_mixed = false, in_front = true;
      double reach = 0, z = 0;
      const Eigen::Vector2d middle =
          reference::Transfer(made.problem.reference, source, reference::ToDouble(plane), {col, row}, &z);
      if (!(z > 0) || !source.camera.Contains(middle)) continue;
      for (int i = 0; i < kPatchSamples; ++i) {
        const Eigen::Vector2d pixel(col + WindowCol(i), row + WindowRow(i));
        const Eigen::Vector2d there =
            reference::Transfer(made.problem.reference, source, reference::ToDouble(plane), pixel, &z);
        in_front = in_front && z > 0;
        reach = std::max(reach, (there - middle).cwiseAbs().maxCoeff());
        is_mixed = is_mixed || IsMixed(mask, there);
      }
      if (!in_front) continue;
      const bool reaches = ReachesMasked(context, view, warp);
      EXPECT_TRUE(reaches || !is_mixed) << "seed " << seed << ", trial " << trial;
      with_ignored += is_mixed ? 1 : 0;
      const bool is_far = DistanceOverReach(mask, middle, reach) > 2;
      clear += is_far ? 1 : 0;
      needlessly += is_far && reaches ? 1 : 0;
    }
  }
  EXPECT_GT(with_ignored, 500);
  EXPECT_GT(clear, 1500);
  // What is foreshortened reaches less far on one side than is assumed for both.
  EXPECT_LT(needlessly, clear / 20);
}

TEST(MaskedWindowTest, AWindowAtTheSameScaleIsClearFromSevenPixelsOn) {
  MaskedViews made(3);
  Mask mask(made.views[1].camera.width, made.views[1].camera.height, 255);
  mask(20, 15) = 0;
  const ClearanceMap clearance = MakeClearance(mask);
  made.problem.sources[0].clearance = clearance.View();
  KernelState state(made.problem);
  const auto context = state.Context();
  for (int distance = 0; distance < 12; ++distance) {
    const PlaneWarp warp = {{20.0f + static_cast<float>(distance), 15, 1}, {1, 0, 0}, {0, 1, 0}};
    EXPECT_EQ(ReachesMasked(context, 0, warp), distance < 7) << distance;
  }
}

TEST(MaskedPatchTest, IgnoredSamplesHaveNoWeightAndTheirValuesNoInfluence) {
  MaskedViews made(7);
  const Mask& mask = made.masks[0];
  std::vector<GrayImage> grays;
  for (const float ignored : {0.0f, 250.0f}) {
    grays.push_back(made.views[0].gray.Clone());
    for (size_t i = 0; i < mask.size(); ++i) {
      if (mask.data()[i] == 0) grays.back().data()[i] = ignored;
    }
  }
  int near = 0;
  for (const WindowFunctions& functions : SupportedWindowFunctions()) {
    for (int row = 0; row < mask.height(); ++row) {
      for (int col = 0; col < mask.width(); ++col) {
        if (mask(col, row) == 0) continue;
        ReferencePatch patches[2][2];
        for (int which = 0; which < 2; ++which) {
          made.problem.reference.gray = grays[static_cast<size_t>(which)].View();
          KernelState state(made.problem);
          const auto plain = state.Context();
          const std::vector<ImageView<const float>> sources;
          const auto fast =
              state.ContextWith(MaskedCpuSampler{{made.problem.reference.gray, sources.data()}, functions});
          const float sigma = state.options().sigma_color;
          LoadUnmaskedPatch(plain, col, row, sigma, SingleThread(), &patches[which][0]);
          LoadUnmaskedPatch(fast, col, row, sigma, SingleThread(), &patches[which][1]);
        }
        double weights = 0, sum = 0;
        for (int i = 0; i < kPatchSamples; ++i) {
          const int x = col + WindowCol(i), y = row + WindowRow(i);
          const bool counts = mask.View().Contains(x, y) && mask(x, y) != 0;
          near += mask.View().Contains(x, y) && !counts ? 1 : 0;
          for (int kind = 0; kind < 2; ++kind) {
            const PatchSample& sample = patches[0][kind].samples[i];
            EXPECT_EQ(sample.weight > 0, counts);
            EXPECT_EQ(sample.weight, patches[1][kind].samples[i].weight);
            EXPECT_EQ(sample.value, patches[1][kind].samples[i].value);
          }
          weights += patches[0][0].samples[i].weight;
          sum += patches[0][0].samples[i].weight * patches[0][0].samples[i].value;
        }
        EXPECT_NEAR(patches[0][0].mean, sum / weights, 1e-3);
        for (int kind = 0; kind < 2; ++kind) {
          EXPECT_EQ(patches[0][kind].mean, patches[1][kind].mean);
          EXPECT_EQ(patches[0][kind].variance, patches[1][kind].variance);
        }
      }
    }
  }
  EXPECT_GT(near, 500);
}

TEST(MaskedMedianTest, PixelsThatTheMaskIgnoresKeepNoPlaneAndDoNotCount) {
  MaskedViews made(9);
  KernelState state(made.problem);
  const auto context = state.Context();
  const Mask& mask = made.masks[0];
  constexpr float kDepth = 3, kTilted = 0.2f;
  int beside = 0;
  for (int row = 0; row < mask.height(); ++row) {
    for (int col = 0; col < mask.width(); ++col) {
      if (mask(col, row) != 0) state.planes(col, row) = {0, 0, -1, kDepth + kTilted * static_cast<float>(col % 2)};
    }
  }
  for (int row = 0; row < mask.height(); ++row) {
    for (int col = 0; col < mask.width(); ++col) {
      MedianFilterPixel(context, col, row);
      const PlaneHypothesis& plane = state.planes(col, row);
      if (mask(col, row) == 0) {
        EXPECT_EQ(plane.d, 0);
        continue;
      }
      beside += context.IsNearMasked(col, row, kMedianReach) ? 1 : 0;
      EXPECT_GE(plane.d, kDepth) << col << ' ' << row;
      EXPECT_LE(plane.d, kDepth + kTilted) << col << ' ' << row;
    }
  }
  EXPECT_GT(beside, 100);
}

TEST(MaskedEvidenceTest, GreyValuesThatMasksIgnoreHaveNoInfluence) {
  MaskedViews made(11);
  std::vector<GrayImage> changed;
  PatchMatchProblem other = made.problem;
  for (size_t i = 0; i < made.views.size(); ++i) {
    changed.push_back(made.views[i].gray.Clone());
    for (size_t k = 0; k < changed[i].size(); ++k) {
      if (made.masks[i].data()[k] == 0) changed[i].data()[k] = 255 - changed[i].data()[k];
    }
  }
  other.reference.gray = changed[0].View();
  for (size_t i = 0; i < other.sources.size(); ++i) other.sources[i].gray = changed[i + 1].View();
  KernelState state(made.problem), state_of_other(other);
  const auto context = state.Context(), context_of_other = state_of_other.Context();
  TestRandom random(5);
  int near = 0, evident = 0;
  for (int row = 0; row < state.height(); ++row) {
    for (int col = 0; col < state.width(); ++col) {
      const PlaneHypothesis plane = RandomHypothesis(made.views[0].camera, col, row, 3.5, 4.5, 20, &random);
      if (context.IsMasked(col, row)) {
        EXPECT_EQ(DepthEvidence(context, col, row), 0);
        continue;
      }
      state.planes(col, row) = state_of_other.planes(col, row) = plane;
      const float evidence = DepthEvidence(context, col, row);
      EXPECT_EQ(evidence, DepthEvidence(context_of_other, col, row)) << col << ' ' << row;
      near += context.IsNearMasked(col, row, kPatchRadius) ? 1 : 0;
      evident += evidence != 0 ? 1 : 0;
    }
  }
  EXPECT_GT(near, 100);
  EXPECT_GT(evident, 10);
}

}  // namespace
}  // namespace acmp
