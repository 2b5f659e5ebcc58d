#include "acmp_mapping/patch_match/match_setup.h"

#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/host_passes.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "support/error_text.h"
#include "support/kernel_state.h"
#include "support/random_views.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Beyond what papers_test.cpp compares.
TEST(GeometricErrorTest, BackwardPointBehindTheReferenceIsTruncated) {
  // The source stands 5 m ahead on the optical axis, looking back at the reference; its depth claims a surface 8 m
  // away, which lies 3 m behind the reference camera. On the axis a point behind has the pixel of one in front.
  std::vector<PlanarView> views = RandomViews(2, 33, 27, 4);
  views[0].camera.cx = 16;
  views[0].camera.cy = 13;
  views[1].cam_from_world = LookAhead({0, 0, 5}, 180, 0, 0);
  for (const auto& [depth, is_before] : {std::pair(8.0f, false), {2.0f, true}}) {
    for (float& z : views[1].depth) z = depth;
    KernelState state(MakeProblem(views, 0, {1, 10}, true));
    const float error = GeometricError(state.Context(), 3, 16, 13, 0), worst = state.options().geometric_max_px;
    EXPECT_TRUE(is_before ? error < 0.01f : error == worst) << error;
  }
}

TEST(GeometricErrorTest, PointBehindTheSourceIsTruncated) {
  // The source stands 4 m ahead on the optical axis and sees a surface 1 m before it, 5 m from the reference. On the
  // axis a point behind it has the pixel of one in front.
  std::vector<PlanarView> views = RandomViews(2, 33, 27, 4);
  views[0].camera.cx = 16;
  views[0].camera.cy = 13;
  views[1].cam_from_world = LookAhead({0, 0, 4}, 0, 0, 0);
  for (float& z : views[1].depth) z = 1;
  KernelState state(MakeProblem(views, 0, {1, 10}, true));
  EXPECT_EQ(GeometricError(state.Context(), 3, 16, 13, 0), state.options().geometric_max_px);
  EXPECT_LT(GeometricError(state.Context(), 5, 16, 13, 0), 0.01f);
}

TEST(RunPassTest, RefusesAStartOfAnotherSize) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 6);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const auto error = [&](int width, int cost_height) {
    EstimateState start = {PlaneMap(width, 27, {0, 0, -1, 4}), CostMap(33, cost_height, 0.5f)};
    return ErrorOf([&] { RunPass(problem, {}, Pass::kGeometric, std::move(start)); });
  };
  EXPECT_EQ(error(33, 27), "no error");
  EXPECT_THAT(error(34, 27), testing::AllOf(HasSubstr("planes"), HasSubstr("34 x 27"), HasSubstr("33 x 27")));
  EXPECT_THAT(error(33, 26), testing::AllOf(HasSubstr("costs"), HasSubstr("33 x 26")));
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
