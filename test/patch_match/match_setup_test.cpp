#include "acmp_mapping/patch_match/match_setup.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/host_passes.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(MatchSetupTest, SourceViewsProjectThereAndBack) {
  std::vector<PlanarView> views = RandomViews(5, 65, 49, 1);
  // A reference that is not the world's origin.
  views[0].cam_from_world = LookAhead({0.2, -0.1, 0.3}, 10, -5, 30);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const std::vector<SourceView> sources = MakeSourceViews(problem);
  ASSERT_EQ(sources.size(), 4u);
  TestRandom random(2);
  for (int i = 0; i < 400; ++i) {
    const SourceView& source = sources[i % 4];
    const MatchView& view = problem.sources[i % 4];
    const Eigen::Vector2d pixel(random(0, 64), random(0, 48));
    const double depth = random(1, 10);
    const Eigen::Vector3d world =
        problem.reference.cam_from_world.inverse() * problem.reference.camera.Unproject(pixel, depth);
    const Eigen::Vector3d in_source = view.cam_from_world * world;
    const Eigen::Vector2d expected = view.camera.Project(in_source);
    const Vec3f projected = static_cast<float>(depth) *
                                (source.a * Vec3f{static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), 1}) +
                            source.b;
    // Homogeneous coordinates of up to 700 in float.
    EXPECT_NEAR(projected.z, in_source.z(), 1e-5);
    EXPECT_NEAR(projected.x, expected.x() * in_source.z(), 1e-3);
    EXPECT_NEAR(projected.y, expected.y() * in_source.z(), 1e-3);
    const Vec3f back =
        static_cast<float>(in_source.z()) *
            (source.back_a * Vec3f{static_cast<float>(expected.x()), static_cast<float>(expected.y()), 1}) +
        source.back_b;
    EXPECT_NEAR(back.z, depth, 1e-5);
    EXPECT_NEAR(back.x, pixel.x() * depth, 2e-3);
    EXPECT_NEAR(back.y, pixel.y() * depth, 2e-3);
    EXPECT_EQ(source.width, static_cast<float>(view.camera.width));
    EXPECT_EQ(source.height, static_cast<float>(view.camera.height));
    EXPECT_TRUE(source.depth.empty());  // depends on the device
  }
}

TEST(HalveDepthTest, WithoutDepthMapsThereAreNone) {
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 3);
  const std::vector<HalvedDepthMap> depths = HalveDepths(MakeProblem(views, 0, {1, 10}));
  ASSERT_EQ(depths.size(), 2u);
  for (const HalvedDepthMap& depth : depths) EXPECT_TRUE(depth.View().empty());
}

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

TEST(HalveDepthTest, NearestIsTheLastStepAndTheFarthestStaysKnown) {
  DepthMap depth(6, 2, 4.0f);
  depth(0, 0) = depth(1, 0) = depth(0, 1) = depth(1, 1) = 0.25f;
  for (const int col : {4, 5}) depth(col, 0) = depth(col, 1) = 1e9f;  // nearer to nothing than to a step
  const HalvedDepthMap halved = HalveDepth(depth);
  EXPECT_EQ(halved.inverse(0, 0), 65535);
  EXPECT_FLOAT_EQ(halved.step, 4.0f / 65535);
  EXPECT_EQ(halved.inverse(1, 0), 4096);  // 65535 / 16 = 4095.9
  EXPECT_EQ(halved.inverse(2, 0), 1);
}

TEST(HalveDepthTest, WhatIsNoDepthIsUnknown) {
  for (const float depth : {0.0f, -3.0f, 1e-38f, std::numeric_limits<float>::infinity()}) {
    const HalvedDepthMap halved = HalveDepth(DepthMap(3, 3, depth));
    for (const uint16_t steps : halved.inverse) EXPECT_EQ(steps, 0) << depth;
  }
}

TEST(MatchSetupTest, DepthMapHasThePlanesDepthsAndZeroForNone) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 4);
  PlaneMap planes(33, 27);
  TestRandom random(5);
  for (int row = 0; row < 27; ++row) {
    for (int col = 0; col < 33; ++col) {
      if ((col + row) % 3 != 0) planes(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
    }
  }
  const DepthMap depth = ToDepthMap(planes, views[0].camera);
  const NormalMap normal = ToNormalMap(planes);
  for (int row = 0; row < 27; ++row) {
    for (int col = 0; col < 33; ++col) {
      EXPECT_EQ(normal(col, row).x, planes(col, row).nx);
      EXPECT_EQ(normal(col, row).z, planes(col, row).nz);
      if ((col + row) % 3 == 0) {
        EXPECT_EQ(depth(col, row), 0);
      } else {
        EXPECT_NEAR(
            depth(col, row),
            reference::Intersect(views[0].camera, Eigen::Vector2d(col, row), reference::ToDouble(planes(col, row))).z(),
            1e-5);
      }
    }
  }
  EXPECT_THROW(ToDepthMap(planes, TestCamera(33, 28)), InvalidInputError);
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
