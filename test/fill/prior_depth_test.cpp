#include "acmp_mapping/fill/prior_depth.h"

#include <cmath>
#include <functional>

#include "acmp_mapping/common/random.h"
#include "support/error_text.h"
#include "support/planar_scene.h"

// How depth from outside is fitted, where it is refused, and which pixels take it.

namespace acmp {
namespace {

constexpr int kPriorWidth = 120, kPriorHeight = 90;
constexpr DepthRange kPriorRange = {0.5f, 10};
constexpr PriorDepthOptions kFitted = {false}, kMetric = {true};

/// Two walls that meet, and a box before them.
float TrueDepth(int col, int row) {
  if (col > 20 && col < 50 && row > 30 && row < 70) return 1.5f;
  return col < 60 ? 1 / (0.25f + 0.002f * static_cast<float>(col))
                  : 1 / (0.37f - 0.003f * static_cast<float>(col - 60));
}

using PixelDepth = std::function<float(int col, int row)>;

DepthMap MakeDepth(const PixelDepth& depth) {
  DepthMap map(kPriorWidth, kPriorHeight);
  for (int row = 0; row < kPriorHeight; ++row) {
    for (int col = 0; col < kPriorWidth; ++col) map(col, row) = depth(col, row);
  }
  return map;
}

/// True in the left two thirds, but for one pixel in five which is anything.
DepthMap Known() {
  return MakeDepth([](int col, int row) {
    const uint32_t hash = HashWord(static_cast<uint32_t>(row * kPriorWidth + col));
    if (col >= 80) return 0.0f;
    return hash % 5 == 0 ? 0.6f + static_cast<float>(hash % 1000) * 0.005f : TrueDepth(col, row);
  });
}

float Random(int col, int row) {
  return 0.6f + static_cast<float>(HashWord(static_cast<uint32_t>(row * kPriorWidth + col) + 77) % 1000) * 0.005f;
}

/// Share of the pixels for which `counts` holds whose depth is within 1 %.
double ShareRight(const DepthMap& depth, const std::function<bool(int, int)>& counts) {
  int right = 0, all = 0;
  for (int row = 0; row < kPriorHeight; ++row) {
    for (int col = 0; col < kPriorWidth; ++col) {
      if (!counts(col, row)) continue;
      ++all;
      right += std::abs(depth(col, row) / TrueDepth(col, row) - 1) < 0.01f ? 1 : 0;
    }
  }
  return static_cast<double>(right) / all;
}

DepthMap Drifting(const std::function<float(float)>& scale) {
  return MakeDepth(
      [&](int col, int row) { return TrueDepth(col, row) * scale(static_cast<float>(col) / kPriorWidth); });
}

TEST(FitPriorDepthTest, FindsScaleShiftAndDriftAmongOutliers) {
  const auto is_unknown = [](int col, int) { return col >= 80; };
  const auto relative = [](int col, int row) { return 7 / (1 / TrueDepth(col, row) + 0.3f); };
  const FittedPriorDepth fitted = FitPriorDepth(MakeDepth(relative), Known(), kPriorRange, kFitted);
  EXPECT_EQ(fitted.rejection, "");
  EXPECT_GT(ShareRight(fitted.depth, is_unknown), 0.99);
  // A scale that drifts is followed far from what is known, too.
  const auto is_hole = [](int col, int) { return col >= 60 && col < 100; };
  const DepthMap known = MakeDepth([&](int col, int row) { return is_hole(col, row) ? 0 : TrueDepth(col, row); });
  const DepthMap drifting = Drifting([](float x) { return 3 * (0.95f + 0.1f * x); });
  EXPECT_GT(ShareRight(FitPriorDepth(drifting, known, kPriorRange, kFitted).depth, is_hole), 0.95);
  // And near it one that wavers.
  const auto is_near = [](int col, int) { return col < 70; };
  const DepthMap wavering = Drifting([](float x) { return 1 + 0.04f * std::sin(6 * x); });
  EXPECT_GT(ShareRight(FitPriorDepth(wavering, Known(), kPriorRange, kFitted).depth, is_near),
            ShareRight(wavering, is_near) + 0.3);
}

TEST(FitPriorDepthTest, WhatIsMetricIsTrustedAsItIsOrNotAtAll) {
  const DepthMap prior = Drifting([](float x) { return 0.98f + 0.05f * x; });
  const FittedPriorDepth metric = FitPriorDepth(prior, Known(), kPriorRange, kMetric);
  ASSERT_FALSE(metric.depth.empty());
  EXPECT_FLOAT_EQ(metric.depth(70, 5), prior(70, 5));
  EXPECT_FLOAT_EQ(metric.depth(110, 5), prior(110, 5));
  const DepthMap nothing(kPriorWidth, kPriorHeight);
  EXPECT_FLOAT_EQ(FitPriorDepth(prior, nothing, kPriorRange, kMetric).depth(70, 5), prior(70, 5));
  const DepthMap twice = Drifting([](float) { return 2.0f; });
  EXPECT_THAT(FitPriorDepth(twice, Known(), kPriorRange, kMetric).rejection, HasSubstr("it explains"));
}

TEST(FitPriorDepthTest, RefusesWhatExplainsNoMoreThanAPlane) {
  const auto refusal = [](const PixelDepth& depth) {
    const FittedPriorDepth fitted = FitPriorDepth(MakeDepth(depth), Known(), kPriorRange, kFitted);
    EXPECT_TRUE(fitted.depth.empty());
    return fitted.rejection;
  };
  EXPECT_THAT(refusal([](int, int) { return 2.0f; }), HasSubstr("it explains"));
  EXPECT_THAT(refusal(Random), HasSubstr("it explains"));
  EXPECT_THAT(refusal([](int col, int) { return 1 / (0.2f + 0.004f * static_cast<float>(col)); }),
              HasSubstr("that no plane explains"));
  EXPECT_THAT(refusal([](int col, int row) { return 1 / (0.8f - 1 / TrueDepth(col, row)); }), HasSubstr("it explains"))
      << "near and far are exchanged";
  EXPECT_THAT(refusal([](int col, int) { return col < 80 ? 0.0f : 2.0f; }), HasSubstr("only 0 of its pixels"));
}

TEST(FitPriorDepthTest, IsNotUsedWhereTheImagesSpeakAgainstIt) {
  const auto is_wrong = [](int col, int) { return col >= 4 && col < 18; };
  const auto wrong_wall = [&](int col, int row) { return is_wrong(col, row) ? 4.5f : TrueDepth(col, row); };
  for (const PriorDepthOptions& options : {kFitted, kMetric}) {
    SCOPED_TRACE(options.metric);
    const FittedPriorDepth fitted = FitPriorDepth(MakeDepth(wrong_wall), Known(), kPriorRange, options);
    ASSERT_FALSE(fitted.depth.empty());
    for (int row = 0; row < kPriorHeight; ++row) EXPECT_EQ(fitted.depth(11, row), 0);
    EXPECT_GT(ShareRight(fitted.depth, [](int col, int) { return col > 26 && col < 74; }), 0.98);
  }
}

TEST(PlaneOfPixelTest, IsThePlaneOfItsSurfaceAndMeetsItsDepth) {
  const PinholeCamera camera = TestCamera(kPriorWidth, kPriorHeight);
  const RayGrid rays = MakeRayGrid(camera);
  const PlaneHypothesis slanted = PlaneThrough(Normalized(Vec3f{0.5f, 0.2f, -0.8f}), {0, 0, 1}, 3);
  const auto depth = MakeDepth([&](int col, int row) {
    if (row == 3) return 0.0f;
    if (col < 40) return 1.0f;  // another surface beside it
    return PlaneDepth(slanted, rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  });
  for (int col = 0; col < kPriorWidth; ++col) {
    EXPECT_EQ(PlaneOfPixel(depth, rays, col, 3).d, 0);
    const PlaneHypothesis plane = PlaneOfPixel(depth, rays, col, 40);
    EXPECT_NEAR(PlaneDepth(plane, rays.Ray(static_cast<float>(col), 40)), depth(col, 40), 1e-4f * depth(col, 40));
    const Vec3f expected = col < 40 ? Vec3f{0, 0, -1} : slanted.normal();
    EXPECT_GT(Dot(plane.normal(), expected), 0.999f) << col;
  }
}

/// All is known but for the right third, of which no view confirms a pixel, and one confirms some.
class UsePriorDepthTest : public ::testing::Test {
 protected:
  UsePriorDepthTest() {
    frame_.camera = TestCamera(kPriorWidth, kPriorHeight);
    const RayGrid rays = MakeRayGrid(frame_.camera);
    for (int row = 0; row < kPriorHeight; ++row) {
      for (int col = 0; col < kPriorWidth; ++col) {
        const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
        planes_(col, row) = PlaneThrough({0, 0, -1}, ray, col < 80 ? TrueDepth(col, row) : 5);
        cost_(col, row) = col < 80 ? 0.05f : col < 90 ? kUnverifiedCost : kWorstCost;
      }
    }
    planes_(100, 20) = {};  // masked
    frame_.prior_depth = MakeDepth([](int col, int row) { return col == 110 ? 0.0f : 2 * TrueDepth(col, row); });
  }

  std::string Use(bool in_scale_of_frame = true, const PriorDepthOptions& options = kFitted) {
    return UsePriorDepth(frame_, in_scale_of_frame, kPriorRange, options, cost_, planes_.View());
  }
  float DepthAt(int col, int row) const {
    return PlaneDepth(planes_(col, row),
                      MakeRayGrid(frame_.camera).Ray(static_cast<float>(col), static_cast<float>(row)));
  }

  Frame frame_;
  PlaneMap planes_{kPriorWidth, kPriorHeight};
  CostMap cost_{kPriorWidth, kPriorHeight};
};

TEST_F(UsePriorDepthTest, PixelsThatNoViewConfirmsTakeIt) {
  const PlaneMap before = planes_.Clone();
  EXPECT_EQ(Use(), "");
  EXPECT_NEAR(DepthAt(105, 30), TrueDepth(105, 30), 0.01f * TrueDepth(105, 30));
  for (const int col : {10, 30, 79, 85, 110}) EXPECT_EQ(planes_(col, 30).d, before(col, 30).d) << col;
  EXPECT_EQ(planes_(100, 20).d, 0) << "masked";
}

TEST_F(UsePriorDepthTest, LandmarksCountWhereNoViewConfirmsAnything) {
  for (float& cost : cost_) cost = kWorstCost;
  EXPECT_THAT(Use(), HasSubstr("only 0 of its pixels"));
  for (int row = 2; row < kPriorHeight; row += 4) {
    for (int col = 2; col < 80; col += 4) {
      frame_.landmarks_in_world.push_back(
          frame_.camera.Unproject({static_cast<double>(col), static_cast<double>(row)}, TrueDepth(col, row)));
    }
  }
  EXPECT_THAT(Use(false), HasSubstr("only 0 of its pixels")) << "landmarks have another scale";
  EXPECT_EQ(Use(), "");
  EXPECT_NEAR(DepthAt(105, 30), TrueDepth(105, 30), 0.01f * TrueDepth(105, 30));
}

}  // namespace
}  // namespace acmp
