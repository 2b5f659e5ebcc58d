#include <functional>
#include <limits>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"
#include "support/random_views.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

template <class T>
std::string MessageOf(const T& value, void (*check)(const T&)) {
  try {
    check(value);
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "";
}

TEST(PatchMatchOptionsTest, NamesTheFieldOutOfBoundsAndItsBounds) {
  struct Case {
    std::function<void(PatchMatchOptions*)> change;
    const char* message;  ///< empty: legal
  };
  for (const Case& c : std::vector<Case>{
           {[](PatchMatchOptions* o) { o->view_draws = 255; }, ""},
           {[](PatchMatchOptions* o) { o->view_draws = 256; }, "patch_match.view_draws = 256: must be in [1, 255]"},
           {[](PatchMatchOptions* o) { o->photometric_iterations = 0; }, "photometric_iterations = 0"},
           {[](PatchMatchOptions* o) { o->planar_prior_iterations = 21; }, "planar_prior_iterations = 21"},
           {[](PatchMatchOptions* o) { o->geometric_weight = 0; }, ""},
           {[](PatchMatchOptions* o) { o->sigma_color = 0; }, "sigma_color = 0"},
           {[](PatchMatchOptions* o) { o->view_smoothness = 0.49f; }, "view_smoothness = 0.49"},
           {[](PatchMatchOptions* o) { o->perturb_depth = kNan; }, "perturb_depth = nan"},
           {[](PatchMatchOptions* o) { o->geometric_max_px = kInf; }, "geometric_max_px = inf"}}) {
    PatchMatchOptions options;
    c.change(&options);
    const std::string message = MessageOf<PatchMatchOptions>(options, Validate);
    EXPECT_THAT(message, HasSubstr(c.message));
    EXPECT_EQ(message.empty(), c.message[0] == 0) << message;
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
    const std::string message = MessageOf<PatchMatchProblem>(problem, Check);
    for (const char* part : c.message) EXPECT_THAT(message, HasSubstr(part));
    EXPECT_EQ(message.empty(), c.message.empty()) << message;
  }
}

}  // namespace
}  // namespace acmp
