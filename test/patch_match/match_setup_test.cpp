#include "acmp_mapping/patch_match/match_setup.h"

#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

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
