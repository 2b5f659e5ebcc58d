#include <functional>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"
#include "support/random_views.h"

namespace acmp {
namespace {

using ::testing::AllOf;
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

std::string Message(const PatchMatchOptions& options) { return MessageOf<PatchMatchOptions>(options, Validate); }
std::string Message(const PatchMatchProblem& problem) { return MessageOf<PatchMatchProblem>(problem, Check); }

struct IntField {
  const char* name;
  int PatchMatchOptions::*field;
  int low, high;
};

struct FloatField {
  const char* name;
  float PatchMatchOptions::*field;
  std::vector<float> good, bad;
};

TEST(PatchMatchOptionsTest, EveryIntegersBoundsAreChecked) {
  for (const IntField& field : {
           IntField{"photometric_iterations", &PatchMatchOptions::photometric_iterations, 1, 20},
           {"planar_prior_iterations", &PatchMatchOptions::planar_prior_iterations, 1, 20},
           {"geometric_iterations", &PatchMatchOptions::geometric_iterations, 1, 20},
           {"view_draws", &PatchMatchOptions::view_draws, 1, 255},
           {"min_neighbours_per_view", &PatchMatchOptions::min_neighbours_per_view, 0, 5},
       }) {
    PatchMatchOptions options;
    for (const int good : {field.low, field.high}) {
      options.*field.field = good;
      EXPECT_EQ(Message(options), "") << field.name << " = " << good;
    }
    for (const int bad : {field.low - 1, field.high + 1, -1000, 100000}) {
      options.*field.field = bad;
      EXPECT_THAT(Message(options), AllOf(HasSubstr(Concat(field.name, " = ", bad)),
                                          HasSubstr(Concat("[", field.low, ", ", field.high, "]"))));
    }
  }
}

TEST(PatchMatchOptionsTest, EveryRealNumbersBoundsAreChecked) {
  for (const FloatField& field : {
           FloatField{"sigma_spatial_px", &PatchMatchOptions::sigma_spatial_px, {0.1f, 100}, {0, -1}},
           {"sigma_color", &PatchMatchOptions::sigma_color, {0.1f, 255}, {0, -1}},
           {"edge_sigma_color", &PatchMatchOptions::edge_sigma_color, {0.1f, 255}, {0, -1}},
           {"edge_bend", &PatchMatchOptions::edge_bend, {0.001f, 10}, {0, -1}},
           {"min_variance", &PatchMatchOptions::min_variance, {1e-4f, 100}, {0, -1}},
           {"sigma_view", &PatchMatchOptions::sigma_view, {0.05f, 2}, {0, -1}},
           {"view_smoothness", &PatchMatchOptions::view_smoothness, {0.5f, 1}, {0.49f, 1.01f}},
           {"perturb_depth", &PatchMatchOptions::perturb_depth, {1e-4f, 0.9f}, {0, 1, -0.5f}},
           {"perturb_normal_deg", &PatchMatchOptions::perturb_normal_deg, {0.01f, 89}, {0, 91, -1}},
           {"prior_alpha", &PatchMatchOptions::prior_alpha, {0.01f, 10}, {0, -1}},
           {"prior_gamma", &PatchMatchOptions::prior_gamma, {0.01f, 10}, {0, -1}},
           {"prior_sigma_normal_deg", &PatchMatchOptions::prior_sigma_normal_deg, {0.1f, 90}, {0, -1, 181}},
           {"prior_depth_divisor", &PatchMatchOptions::prior_depth_divisor, {1, 1000}, {0, -1}},
           {"prior_start_cost", &PatchMatchOptions::prior_start_cost, {0, 2}, {-0.01f, 2.01f}},
           {"geometric_weight", &PatchMatchOptions::geometric_weight, {0, 10}, {-0.01f}},
           {"geometric_max_px", &PatchMatchOptions::geometric_max_px, {0.1f, 100}, {0, -1}},
       }) {
    PatchMatchOptions options;
    for (const float good : field.good) {
      options.*field.field = good;
      EXPECT_EQ(Message(options), "") << field.name << " = " << good;
    }
    std::vector<float> bad = field.bad;
    bad.insert(bad.end(), {kNan, kInf, -kInf});
    for (const float value : bad) {
      options.*field.field = value;
      EXPECT_THAT(Message(options), HasSubstr(Concat("patch_match.", field.name, " = ", value, ":")));
    }
  }
}

/// A good problem and the views it points into.
struct ProblemCase {
  ProblemCase() : views(RandomViews(3, 33, 27, 1)), problem(MakeProblem(views, 0, {1, 10}, true)) {}
  std::vector<PlanarView> views;
  PatchMatchProblem problem;
};

TEST(PatchMatchProblemTest, AcceptsOneToThirtyTwoSourcesOfAnySize) {
  ProblemCase c;
  EXPECT_EQ(Message(c.problem), "");
  c.problem.sources.resize(1);
  EXPECT_EQ(Message(c.problem), "");
  while (c.problem.sources.size() < 32) c.problem.sources.push_back(c.problem.sources[0]);
  EXPECT_EQ(Message(c.problem), "");
}

TEST(PatchMatchProblemTest, RefusesOtherNumbersOfSources) {
  ProblemCase c;
  const MatchView source = c.problem.sources[0];
  c.problem.sources.clear();
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("source views = 0"), HasSubstr("[1, 32]")));
  c.problem.sources.assign(33, source);
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("source views = 33"), HasSubstr("[1, 32]")));
}

TEST(PatchMatchProblemTest, NamesTheViewWithABadCameraOrSize) {
  ProblemCase c;
  c.problem.reference.camera.fx = 0;
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("reference view"), HasSubstr("fx = 0")));
  c = ProblemCase();
  c.problem.sources[1].camera.cy = kNan;
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("source view 1"), HasSubstr("cy = nan")));
  c = ProblemCase();
  c.problem.reference.gray.width = 32;
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("reference view"), HasSubstr("32 x 27"), HasSubstr("33 x 27")));
  c = ProblemCase();
  c.problem.sources[0].gray = {};
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("source view 0"), HasSubstr("0 x 0")));
  c = ProblemCase();
  c.problem.sources[0].gray.data = nullptr;
  EXPECT_THAT(Message(c.problem), HasSubstr("source view 0"));
}

TEST(PatchMatchProblemTest, NamesTheViewWithABadDepthMap) {
  ProblemCase c;
  c.problem.sources[1].depth.height -= 1;
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("source view 1"), HasSubstr("depth map")));
}

TEST(PatchMatchProblemTest, NamesTheViewWithABadPose) {
  ProblemCase c;
  c.problem.sources[0].cam_from_world.translation().y() = kNan;
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("source view 0"), HasSubstr("pose")));
  c = ProblemCase();
  c.problem.reference.cam_from_world.matrix()(1, 1) = kInf;
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("reference view"), HasSubstr("pose")));
}

TEST(PatchMatchProblemTest, RefusesSourcesWithoutBaseline) {
  ProblemCase c;
  c.problem.sources[1].cam_from_world = c.problem.reference.cam_from_world;
  EXPECT_THAT(Message(c.problem), AllOf(HasSubstr("source view 1"), HasSubstr("baseline"), HasSubstr("= 0")));
  // A pure rotation has no baseline either.
  c.problem.sources[1].cam_from_world = LookAhead({0, 0, 0}, 5, 3, 1) * c.problem.reference.cam_from_world;
  EXPECT_THAT(Message(c.problem), HasSubstr("baseline"));
}

TEST(PatchMatchProblemTest, NamesABadDepthRange) {
  // Also where no baseline can be judged by it: the message must be about the range.
  for (const DepthRange& range :
       {DepthRange{0, 10}, {-1, 10}, {10, 1}, {5, 5}, {1, kInf}, {kNan, 10}, {1, kNan}, {kInf, kInf}, {0, 0}}) {
    ProblemCase c;
    c.problem.depth_range = range;
    EXPECT_THAT(Message(c.problem),
                AllOf(HasSubstr("depth range"), HasSubstr(Concat("[", range.min, ", ", range.max, "]"))));
  }
}

}  // namespace
}  // namespace acmp
