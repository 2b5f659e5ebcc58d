#include "acmp_mapping/patch_match/match_setup.h"

#include <functional>
#include <limits>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "support/error_text.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

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

TEST(CheckStartTest, RefusesOtherSizesAndPixelsWithoutAPlaneInFrontOfTheCamera) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 6);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10});
  const auto error = [&](int width, int cost_height, float d) {
    EstimateState start = {PlaneMap(width, 27, {0, 0, -1, 4}), CostMap(width, cost_height, 0.5f)};
    start.planes(32, 26).d = d;
    return ErrorOf([&] { CheckStart(problem, start); });
  };
  EXPECT_EQ(error(33, 27, 4), "no error");
  EXPECT_THAT(error(34, 27, 4), AllOf(HasSubstr("start"), HasSubstr("34 x 27"), HasSubstr("33 x 27")));
  EXPECT_THAT(error(33, 26, 4), HasSubstr("33 x 26"));
  for (const float d : {0.0f, -1.5f, kNan}) EXPECT_THAT(error(33, 27, d), HasSubstr(Concat("d = ", d)));
}

TEST(PatchMatchProblemTest, NamesWhatIsWrongWithWhichView) {
  struct Case {
    std::function<void(PatchMatchProblem*)> change;
    std::vector<const char*> message;  ///< none: legal
  };
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 1);
  for (const Case& c : std::vector<Case>{
           {[](PatchMatchProblem*) {}, {}},
           {[](PatchMatchProblem* p) { p->sources.resize(32, p->sources[0]); }, {}},
           {[](PatchMatchProblem* p) { p->sources.resize(33, p->sources[0]); }, {"source views = 33", "[1, 32]"}},
           {[](PatchMatchProblem* p) { p->sources.clear(); }, {"source views = 0"}},
           {[](PatchMatchProblem* p) { p->reference.camera.fx = 0; }, {"reference view", "fx = 0"}},
           {[](PatchMatchProblem* p) { p->sources[1].camera.cy = kNan; }, {"source view 1", "cy = nan"}},
           {[](PatchMatchProblem* p) { p->reference.gray.width = 32; }, {"reference view", "32 x 27", "33 x 27"}},
           {[](PatchMatchProblem* p) { p->sources[0].gray.data = nullptr; }, {"source view 0"}},
           {[](PatchMatchProblem* p) { p->sources[1].depth.height -= 1; }, {"source view 1", "depth map"}},
           {[](PatchMatchProblem* p) { p->sources[0].cam_from_world.translation().y() = kNan; },
            {"source view 0", "pose"}},
           {[](PatchMatchProblem* p) {  // a pure rotation
              p->sources[1].cam_from_world = LookAhead({0, 0, 0}, 5, 3, 1) * p->reference.cam_from_world;
            },
            {"source view 1", "baseline"}},
           {[](PatchMatchProblem* p) {
              p->depth_range = {10, 1};
            },
            {"depth range", "[10, 1]"}},
           // Also where no baseline can be judged by it.
           {[](PatchMatchProblem* p) {
              p->depth_range = {kNan, 10};
            },
            {"depth range", "[nan, 10]"}}}) {
    PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
    c.change(&problem);
    const std::string message = ErrorOf([&] { Check(problem); });
    for (const char* part : c.message) EXPECT_THAT(message, HasSubstr(part));
    EXPECT_EQ(message == "no error", c.message.empty()) << message;
  }
}

}  // namespace
}  // namespace acmp
