#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/image/cells.h"
#include "support/devices.h"
#include "support/pass_result.h"
#include "support/random_views.h"

// What holds for whole passes on every device, whatever the images show.

namespace acmp {
namespace {

using ::testing::HasSubstr;

class PassesTest : public DeviceTest {};

constexpr float kMaxPhotometric = 2.0f;
constexpr float kMaxGeometric = 2.5f;  // 2 + 0.1 * min(error, 5)

/// A prior of random planes with holes.
PlaneMap RandomPrior(const PinholeCamera& camera, uint32_t seed) {
  TestRandom random(seed);
  PlaneMap prior(camera.width, camera.height);
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      if (random(0, 1) < 0.7) prior(col, row) = RandomHypothesis(camera, col, row, 2, 8, 60, &random);
    }
  }
  return prior;
}

struct AllPasses {
  PatchMatchResult photometric, planar_prior, geometric;
};

AllPasses RunAll(PatchMatch* patch_match, const PatchMatchProblem& problem, const PatchMatchOptions& options = {}) {
  AllPasses all;
  all.photometric = patch_match->RunPhotometric(problem, options);
  const PlaneMap prior = RandomPrior(problem.reference.camera, 77);
  all.planar_prior = patch_match->RunPlanarPrior(problem, options, all.photometric, prior.View());
  all.geometric = patch_match->RunGeometric(problem, options, all.planar_prior, 0);
  return all;
}

void ExpectAllValid(PatchMatch* patch_match, const PatchMatchProblem& problem, const PatchMatchOptions& options = {}) {
  const AllPasses all = RunAll(patch_match, problem, options);
  ExpectValid(all.photometric, problem, kMaxPhotometric);
  ExpectValid(all.planar_prior, problem, kMaxPhotometric);
  ExpectValid(all.geometric, problem, kMaxGeometric);
}

TEST_P(PassesTest, ResultsAreValidOnOddAndUnequalSizes) {
  for (const auto& [width, height] : {std::pair(37, 29), {64, 21}, {20, 49}}) {
    const std::vector<PlanarView> views = RandomViews(5, width, height, 1);
    ExpectAllValid(patch_match_.get(), MakeProblem(views, 0, {1, 10}, true));
  }
}

TEST_P(PassesTest, ResultsAreValidOnImagesSmallerThanTheWindow) {
  for (const auto& [width, height] : {std::pair(1, 1), {1, 9}, {7, 1}, {2, 2}, {5, 4}, {10, 3}}) {
    std::vector<PlanarView> views = RandomViews(4, 17, 15, 2);
    views[0].camera = TestCamera(width, height);
    views[0].gray = RandomImage(width, height, 3);
    views[2].camera = TestCamera(1, 1);  // a source may be tiny too
    views[2].gray = RandomImage(1, 1, 4);
    views[2].depth = DepthMap(1, 1, 4.0f);
    ExpectAllValid(patch_match_.get(), MakeProblem(views, 0, {1, 10}, true));
  }
}

TEST_P(PassesTest, ResultsAreValidWithOneAndThirtyTwoSources) {
  for (const int count : {1, 2, 31, 32}) {
    const std::vector<PlanarView> views = RandomViews(1 + count, 25, 19, 5);
    const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
    ASSERT_EQ(static_cast<int>(problem.sources.size()), count);
    ExpectAllValid(patch_match_.get(), problem);
  }
}

TEST_P(PassesTest, ResultsAreValidWithoutTexture) {
  for (const bool reference_too : {true, false}) {
    std::vector<PlanarView> views = RandomViews(4, 33, 27, 6);
    for (size_t i = reference_too ? 0 : 1; i < views.size(); ++i) {
      for (float& value : views[i].gray) value = 90.0f + 20.0f * static_cast<float>(i);
    }
    ExpectAllValid(patch_match_.get(), MakeProblem(views, 0, {1, 10}, true));
  }
}

TEST_P(PassesTest, FlatReferenceGivesTheUninformedCostExactly) {
  // Were flat windows compared by rounding noise, some would look well matched.
  std::vector<PlanarView> views = RenderPlanarScene(WorldPlane{}, 40, 30, 4);
  for (float& value : views[0].gray) value = 77.7f;
  const PatchMatchResult result = patch_match_->RunPhotometric(MakeProblem(views, 0, {2, 8}), {});
  for (const float cost : result.cost) ASSERT_TRUE(cost == 1.0f || cost == 2.0f) << cost;
}

TEST_P(PassesTest, ResultsAreValidWhereNoSourceSeesAnything) {
  std::vector<PlanarView> views = RandomViews(4, 33, 27, 7);
  for (size_t i = 1; i < 4; ++i) {
    views[i].cam_from_world = LookAhead({0.1, 0.0, 0.1 * static_cast<double>(i)}, 180, 0, 0);
  }
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  ExpectAllValid(patch_match_.get(), problem);
  const PatchMatchResult result = patch_match_->RunPhotometric(problem, {});
  for (const float cost : result.cost) ASSERT_EQ(cost, 2.0f);
  for (const uint32_t mask : result.selected_views) ASSERT_EQ(mask, 0u);
}

TEST_P(PassesTest, ResultsAreValidUnderExtremeOptionsAndRanges) {
  const std::vector<PlanarView> views = RandomViews(4, 33, 27, 8);
  PatchMatchOptions options;
  options.photometric_iterations = options.planar_prior_iterations = options.geometric_iterations = 20;
  options.perturb_depth = 0.999f;
  options.perturb_normal_deg = 90;
  for (const Method method : {Method::kOurs, Method::kAcmh, Method::kAcmp}) {
    options.method = method;
    options.view_draws = 255;
    options.view_smoothness = 1;
    ExpectAllValid(patch_match_.get(), MakeProblem(views, 0, {1, 10}, true), options);
    options.view_draws = 1;
    options.view_smoothness = 0.5f;
    ExpectAllValid(patch_match_.get(), MakeProblem(views, 0, {1e-3f, 1e5f}, true), options);
  }
  ExpectAllValid(patch_match_.get(), MakeProblem(views, 0, {3.0f, 3.000001f}, true));
}

TEST_P(PassesTest, SameInputGivesTheSameBits) {
  const std::vector<PlanarView> views = RandomViews(5, 61, 45, 9);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const AllPasses first = RunAll(patch_match_.get(), problem);
  // Problems of other sizes and source counts in between: no state may survive.
  for (const auto& [width, height, count] : {std::tuple(80, 70, 8), {10, 9, 2}}) {
    const std::vector<PlanarView> other = RandomViews(count, width, height, 10);
    RunAll(patch_match_.get(), MakeProblem(other, 0, {0.5f, 5}, true));
  }
  const AllPasses again = RunAll(patch_match_.get(), problem);
  const AllPasses fresh = RunAll(MakePatchMatch(GetParam()).patch_match.get(), problem);
  for (const AllPasses* other : {&again, &fresh}) {
    EXPECT_TRUE(SameBits(first.photometric, other->photometric));
    EXPECT_TRUE(SameBits(first.planar_prior, other->planar_prior));
    EXPECT_TRUE(SameBits(first.geometric, other->geometric));
  }
}

TEST_P(PassesTest, SeedAndPassNumberChangeTheRandomNumbers) {
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 11);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  PatchMatchOptions other_seed;
  other_seed.seed = 2;
  const PatchMatchResult start = patch_match_->RunPhotometric(problem, {});
  EXPECT_FALSE(SameBits(start, patch_match_->RunPhotometric(problem, other_seed)));
  const PlaneMap prior = RandomPrior(problem.reference.camera, 12);
  EXPECT_FALSE(SameBits(patch_match_->RunPlanarPrior(problem, {}, start, prior.View()),
                        patch_match_->RunPlanarPrior(problem, other_seed, start, prior.View())));
  const PatchMatchResult geometric = patch_match_->RunGeometric(problem, {}, start, 0);
  EXPECT_FALSE(SameBits(geometric, patch_match_->RunGeometric(problem, other_seed, start, 0)));
  EXPECT_FALSE(SameBits(geometric, patch_match_->RunGeometric(problem, {}, start, 1)));
  EXPECT_TRUE(SameBits(geometric, patch_match_->RunGeometric(problem, {}, start, 0)));
}

TEST_P(PassesTest, InputIsNotModified) {
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 13);
  const std::vector<PlanarView> untouched = RandomViews(3, 33, 27, 13);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const PatchMatchResult start = patch_match_->RunPhotometric(problem, {});
  const PatchMatchResult copy = start.Clone();
  const PlaneMap prior = RandomPrior(problem.reference.camera, 14);
  patch_match_->RunPlanarPrior(problem, {}, start, prior.View());
  patch_match_->RunGeometric(problem, {}, start, 0);
  EXPECT_TRUE(SameBits(start, copy));
  for (size_t i = 0; i < views.size(); ++i) {
    EXPECT_TRUE(std::equal(views[i].gray.begin(), views[i].gray.end(), untouched[i].gray.begin()));
    EXPECT_TRUE(std::equal(views[i].depth.begin(), views[i].depth.end(), untouched[i].depth.begin()));
  }
}

/// A copy of the image inside a larger one whose other pixels are NaN.
template <class T>
struct Padded {
  explicit Padded(const Image<T>& image, const T& filler) : pixels(image.width() + 5, image.height() + 2, filler) {
    for (int row = 0; row < image.height(); ++row) {
      for (int col = 0; col < image.width(); ++col) pixels(col + 3, row + 1) = image(col, row);
    }
    view = {&pixels(3, 1), image.width(), image.height(), pixels.width()};
  }
  Image<T> pixels;
  ImageView<const T> view;
};

TEST_P(PassesTest, RowsMayBePadded) {
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 15);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const AllPasses expected = RunAll(patch_match_.get(), problem);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

  PatchMatchProblem strided = problem;
  std::vector<Padded<float>> storage;
  storage.reserve(5);
  strided.reference.gray = storage.emplace_back(views[0].gray, kNan).view;
  for (size_t i = 1; i < 3; ++i) {
    strided.sources[i - 1].gray = storage.emplace_back(views[i].gray, kNan).view;
    strided.sources[i - 1].depth = storage.emplace_back(views[i].depth, kNan).view;
  }
  const Padded<PlaneHypothesis> prior(RandomPrior(problem.reference.camera, 77), {kNan, kNan, kNan, kNan});
  const PatchMatchResult photometric = patch_match_->RunPhotometric(strided, {});
  EXPECT_TRUE(SameBits(photometric, expected.photometric));
  EXPECT_TRUE(SameBits(patch_match_->RunPlanarPrior(strided, {}, photometric, prior.view), expected.planar_prior));
  EXPECT_TRUE(SameBits(patch_match_->RunGeometric(strided, {}, expected.planar_prior, 0), expected.geometric));
}

TEST_P(PassesTest, MissingDepthMapsCountAsTruncatedEverywhere) {
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 16);
  const PatchMatchResult start = patch_match_->RunPhotometric(MakeProblem(views, 0, {1, 10}), {});
  PatchMatchProblem none = MakeProblem(views, 0, {1, 10});
  std::vector<PlanarView> empty = RandomViews(3, 33, 27, 16);
  for (PlanarView& view : empty) std::fill(view.depth.begin(), view.depth.end(), 0.0f);
  const PatchMatchProblem zero = MakeProblem(empty, 0, {1, 10}, true);
  const PatchMatchResult result = patch_match_->RunGeometric(none, {}, start, 0);
  EXPECT_TRUE(SameBits(result, patch_match_->RunGeometric(zero, {}, start, 0)));
  ExpectValid(result, none, kMaxGeometric);
  // 0.1 * 5 px from every view, unless the pixel has none.
  for (const float cost : result.cost) ASSERT_GE(cost, 0.5f);
}

TEST_P(PassesTest, GeometricResultDoesNotDependOnTheOrderOfImages) {
  // Two images match against each other; each is refined with the other's depths as they were before.
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 17);
  std::vector<PatchMatchResult> start;
  std::vector<DepthMap> depths;
  for (size_t i = 0; i < 2; ++i) {
    start.push_back(patch_match_->RunPhotometric(MakeProblem(views, i, {1, 10}), {}));
    depths.push_back(ToDepthMap(start[i].planes, views[i].camera));
  }
  const auto refine = [&](size_t i) {
    PatchMatchProblem problem;
    problem.reference = views[i].View();
    problem.sources = {views[1 - i].View(), views[2].View()};
    problem.sources[0].depth = std::as_const(depths[1 - i]).View();
    problem.depth_range = {1, 10};
    return patch_match_->RunGeometric(problem, {}, start[i], 0);
  };
  const PatchMatchResult a0 = refine(0), a1 = refine(1);
  const PatchMatchResult b1 = refine(1), b0 = refine(0);
  EXPECT_TRUE(SameBits(a0, b0));
  EXPECT_TRUE(SameBits(a1, b1));
}

TEST_P(PassesTest, BadInputIsRefusedAndLeavesTheObjectUsable) {
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 18);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const PatchMatchResult start = patch_match_->RunPhotometric(problem, {});
  const PlaneMap prior = RandomPrior(problem.reference.camera, 19);

  PatchMatchProblem bad_problem = problem;
  bad_problem.depth_range = {5, 5};
  EXPECT_THROW(patch_match_->RunPhotometric(bad_problem, {}), InvalidInputError);
  EXPECT_THROW(patch_match_->RunPlanarPrior(bad_problem, {}, start, prior.View()), InvalidInputError);
  EXPECT_THROW(patch_match_->RunGeometric(bad_problem, {}, start, 0), InvalidInputError);

  PatchMatchOptions bad_options;
  bad_options.view_draws = 0;
  EXPECT_THROW(patch_match_->RunPhotometric(problem, bad_options), InvalidInputError);
  EXPECT_THROW(patch_match_->RunPlanarPrior(problem, bad_options, start, prior.View()), InvalidInputError);
  EXPECT_THROW(patch_match_->RunGeometric(problem, bad_options, start, 0), InvalidInputError);

  EXPECT_THROW(patch_match_->RunPlanarPrior(problem, {}, {}, prior.View()), InvalidInputError);
  EXPECT_THROW(patch_match_->RunGeometric(problem, {}, {}, 0), InvalidInputError);
  const PlaneMap wrong_size(32, 27);
  EXPECT_THROW(patch_match_->RunPlanarPrior(problem, {}, start, wrong_size.View()), InvalidInputError);

  EXPECT_TRUE(SameBits(start, patch_match_->RunPhotometric(problem, {})));
}

TEST_P(PassesTest, EvidenceIsMeasuredOncePerCell) {
  const std::vector<PlanarView> views = RenderPlanarScene(WorldPlane::Slanted(12, -8, 4), 61, 43, 5);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const PlaneMap planes = patch_match_->RunPhotometric(problem, {}).planes.Clone();
  const Image<float> every = patch_match_->MeasureEvidence(problem, planes, 1);
  const Image<float> cells = patch_match_->MeasureEvidence(problem, planes, 4);
  ASSERT_EQ(every.width(), 61);
  ASSERT_EQ(cells.width(), 16);
  ASSERT_EQ(cells.height(), 11);
  int textured = 0;
  for (int row = 0; row < cells.height(); ++row) {
    for (int col = 0; col < cells.width(); ++col) {
      ASSERT_EQ(cells(col, row), every(MiddleOfCell(col, 4, 61), MiddleOfCell(row, 4, 43))) << col << ", " << row;
      textured += cells(col, row) >= 10 ? 1 : 0;
    }
  }
  EXPECT_GT(textured, 16 * 11 / 2);
  const PatchMatchProblem without = MakeProblem(views, 0, {1, 10}, false);
  for (const float value : patch_match_->MeasureEvidence(without, planes, 4)) ASSERT_EQ(value, 0) << "no view agrees";
}

TEST_P(PassesTest, EvidenceOfOtherSizesIsRefused) {
  const std::vector<PlanarView> views = RenderPlanarScene(WorldPlane::Slanted(12, -8, 4), 31, 23, 3);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  EXPECT_THROW(patch_match_->MeasureEvidence(problem, PlaneMap(31, 22), 4), InvalidInputError);
  EXPECT_THROW(patch_match_->MeasureEvidence(problem, PlaneMap(31, 23), 0), InvalidInputError);
  EXPECT_EQ(patch_match_->MeasureEvidence(problem, PlaneMap(31, 23), 8).width(), 4);
}

TEST_P(PassesTest, ReportsTimeAndName) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 20);
  patch_match_->RunPhotometric(MakeProblem(views, 0, {1, 10}), {});
  EXPECT_GT(patch_match_->last_timing().kernels_ms, 0);
  EXPECT_GE(patch_match_->last_timing().upload_ms, 0);
  EXPECT_GE(patch_match_->last_timing().download_ms, 0);
  EXPECT_THAT(patch_match_->device_name(), HasSubstr(GetParam() == Device::kCuda ? "cuda:0" : "cpu ("));
}

INSTANTIATE_TEST_SUITE_P(Devices, PassesTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

}  // namespace
}  // namespace acmp
