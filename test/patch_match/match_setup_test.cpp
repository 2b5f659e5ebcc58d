#include "acmp_mapping/patch_match/match_setup.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(HalveDepthTest, AgreesWithTheReferenceWithinHalfAStep) {
  TestRandom random(4);
  for (const auto& [width, height] : {std::pair(64, 48), std::pair(33, 27), std::pair(1, 1)}) {
    DepthMap depth(width, height);
    // A fifth unknown; the others in two layers, so that some of the four agree and some do not.
    for (float& z : depth) {
      z = random(0, 1) < 0.2 ? 0.0f : static_cast<float>((random(0, 1) < 0.5 ? 2 : 7) * random(1, 1.02));
    }
    depth(0, 0) = 2;
    const HalvedDepthMap halved = HalveDepth(depth);
    ASSERT_EQ(halved.inverse.width(), (width + 1) / 2);
    ASSERT_EQ(halved.inverse.height(), (height + 1) / 2);
    int known = 0;
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        const double expected = reference::HalvedDepthAt(depth, col, row);
        const int steps = halved.inverse(col / 2, row / 2);
        ASSERT_EQ(steps == 0, expected == 0);
        if (steps == 0) continue;
        ++known;
        // Half a step, and two roundings of float in the mean.
        ASSERT_NEAR(steps * static_cast<double>(halved.step), 1 / expected, 0.51 * halved.step);
      }
    }
    EXPECT_GT(known, 0);
  }
}

TEST(HalveDepthTest, WhatIsNoDepthIsUnknown) {
  for (const float depth : {0.0f, -3.0f, 1e-38f, std::numeric_limits<float>::infinity()}) {
    const HalvedDepthMap halved = HalveDepth(DepthMap(3, 3, depth));
    for (const uint16_t steps : halved.inverse) EXPECT_EQ(steps, 0) << depth;
  }
}

/// Message of the InvalidInputError that the function throws; empty if none.
template <class Function>
std::string MessageOf(const Function& function) {
  try {
    function();
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "";
}

EstimateState GoodStart(int width, int height) {
  return {PlaneMap(width, height, {0, 0, -1, 4}), CostMap(width, height, 0.5f)};
}

TEST(CheckStartTest, RefusesOtherSizes) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 6);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10});
  EXPECT_EQ(MessageOf([&] { CheckStart(problem, GoodStart(33, 27)); }), "");
  EXPECT_THAT(MessageOf([&] { CheckStart(problem, GoodStart(34, 27)); }),
              AllOf(HasSubstr("start"), HasSubstr("34 x 27"), HasSubstr("33 x 27")));
  EstimateState start = GoodStart(33, 27);
  start.cost = CostMap(33, 26);
  EXPECT_THAT(MessageOf([&] { CheckStart(problem, start); }), HasSubstr("33 x 26"));
  EXPECT_NE(MessageOf([&] { CheckStart(problem, EstimateState{}); }), "");
}

TEST(CheckStartTest, RefusesPixelsWithoutAPlaneInFrontOfTheCamera) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 6);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10});
  for (const float d : {0.0f, -1.5f, std::numeric_limits<float>::quiet_NaN()}) {
    EstimateState start = GoodStart(33, 27);
    start.planes(32, 26).d = d;
    EXPECT_THAT(MessageOf([&] { CheckStart(problem, start); }), HasSubstr(Concat("d = ", d)));
  }
}

}  // namespace
}  // namespace acmp
