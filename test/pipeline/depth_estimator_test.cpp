#include "acmp_mapping/pipeline/depth_estimator.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "support/planar_scene.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// Stands in for a device: remembers what it was asked and returns a slanted plane with credible and other pixels.
class FakePatchMatch final : public PatchMatch {
 public:
  PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions& options) override {
    Note("photometric", problem, options);
    return Result(problem, {0, -0.6f, -0.8f, 3.2f});
  }
  PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                  const PatchMatchResult& start, ImageView<const PlaneHypothesis> prior) override {
    Note("planar prior", problem, options);
    start_d = start.planes(0, 0).d;
    last_prior = PlaneMap(prior.width, prior.height);
    for (int row = 0; row < prior.height; ++row) {
      for (int col = 0; col < prior.width; ++col) last_prior(col, row) = prior(col, row);
    }
    return Result(problem, {0, 0, -1, 5});
  }
  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                const PatchMatchResult& start, int pass) override {
    Note(Concat("geometric ", pass), problem, options);
    start_d = start.planes(0, 0).d;
    return Result(problem, {0, 0, -1, 6});
  }
  PatchMatchTiming last_timing() const override { return {1, 10, 1}; }
  std::string device_name() const override { return "fake"; }

  std::vector<std::string> calls;
  PatchMatchProblem last_problem;
  PatchMatchOptions last_options;
  PlaneMap last_prior;
  float start_d = 0;

 private:
  void Note(const std::string& name, const PatchMatchProblem& problem, const PatchMatchOptions& options) {
    calls.push_back(name);
    last_problem = problem;
    last_options = options;
  }
  static PatchMatchResult Result(const PatchMatchProblem& problem, const PlaneHypothesis& plane) {
    const int width = problem.reference.camera.width, height = problem.reference.camera.height;
    // A third of the pixels is credible (cost below 0.1), in every 5 x 5 cell.
    CostMap cost(width, height, 0.5f);
    for (int row = 0; row < height; ++row) {
      for (int col = row % 3; col < width; col += 3) cost(col, row) = 0.05f;
    }
    return {PlaneMap(width, height, plane), std::move(cost), Image<uint32_t>(width, height)};
  }
};

/// Frames that share nothing but their sizes; the fake does not look at them.
struct Frames {
  Frames() {
    for (int i = 0; i < 4; ++i) {
      const PinholeCamera camera = i == 3 ? TestCamera(30, 26) : TestCamera(40, 30);
      frames.push_back(std::make_shared<const Frame>(MakeFrame(i, 0, ColorImage(camera.width, camera.height), camera,
                                                               LookAhead({0.2 * i, 0, 0}, 0, 0, 0), {}, 0)));
    }
  }
  const Frame& reference() const { return *frames[0]; }
  std::vector<FramePtr> sources() const { return {frames[2], frames[1], frames[3]}; }
  std::vector<FramePtr> frames;
};

constexpr DepthRange kRange = {1, 10};

TEST(DepthEstimatorTest, WithoutPriorRunsThePhotometricPassOnly) {
  FakePatchMatch fake;
  DepthEstimator estimator(&fake, MakePreset("acmh"));
  const Frames frames;
  const PatchMatchResult result = estimator.EstimateInitial(frames.reference(), frames.sources(), kRange);
  EXPECT_THAT(fake.calls, ElementsAre("photometric"));
  EXPECT_EQ(result.planes(0, 0).d, 3.2f);
  EXPECT_EQ(estimator.last_times().kernels_ms, 10);
  EXPECT_EQ(estimator.last_times().planar_prior_ms, 0);
}

TEST(DepthEstimatorTest, HandsOverViewsInOrderWithTheirCameras) {
  FakePatchMatch fake;
  PipelineOptions options = MakePreset("acmh");
  options.patch_match.seed = 17;
  DepthEstimator estimator(&fake, options);
  const Frames frames;
  estimator.EstimateInitial(frames.reference(), frames.sources(), kRange);
  EXPECT_EQ(fake.last_options.seed, 17u);
  EXPECT_EQ(fake.last_problem.depth_range.min, 1);
  EXPECT_EQ(fake.last_problem.depth_range.max, 10);
  EXPECT_EQ(fake.last_problem.reference.gray.data, frames.frames[0]->gray.data());
  ASSERT_EQ(fake.last_problem.sources.size(), 3u);
  for (int i = 0; i < 3; ++i) {
    const Frame& expected = *frames.sources()[i];
    const MatchView& view = fake.last_problem.sources[i];
    EXPECT_EQ(view.gray.data, expected.gray.data());
    EXPECT_TRUE(view.camera == expected.camera);
    EXPECT_EQ((view.cam_from_world.matrix() - expected.cam_from_world.matrix()).norm(), 0);
    EXPECT_TRUE(view.depth.empty());
  }
}

TEST(DepthEstimatorTest, PriorComesFromTheCrediblePixelsOfThePhotometricPass) {
  FakePatchMatch fake;
  DepthEstimator estimator(&fake, MakePreset("acmp"));
  const Frames frames;
  const PatchMatchResult result = estimator.EstimateInitial(frames.reference(), frames.sources(), kRange);
  EXPECT_THAT(fake.calls, ElementsAre("photometric", "planar prior"));  // the geometric passes are asked for apart
  EXPECT_EQ(fake.start_d, 3.2f);
  EXPECT_EQ(result.planes(0, 0).d, 5);
  EXPECT_EQ(estimator.last_times().kernels_ms, 20);
  // All credible pixels lie on one plane, so every triangle has that plane; only the rim lies outside all triangles.
  ASSERT_EQ(fake.last_prior.width(), 40);
  ASSERT_EQ(fake.last_prior.height(), 30);
  int with_prior = 0;
  for (const PlaneHypothesis& plane : fake.last_prior) {
    if (!(plane.d > 0)) continue;
    ++with_prior;
    // Triangles down to 5 px across at depth 4: rounding of depths to 1e-7 over about 0.6 m.
    EXPECT_NEAR(plane.nx, 0, 1e-4);
    EXPECT_NEAR(plane.ny, -0.6, 1e-4);
    EXPECT_NEAR(plane.nz, -0.8, 1e-4);
    EXPECT_NEAR(plane.d, 3.2, 1e-3);
  }
  EXPECT_GT(with_prior, 0.6 * 40 * 30);
}

TEST(DepthEstimatorTest, WithoutSupportThePriorIsEmptyAndThePassStillRuns) {
  FakePatchMatch fake;
  PipelineOptions options = MakePreset("acmp");
  options.planar_prior.max_support_cost = 0.01f;  // no pixel is that good
  DepthEstimator estimator(&fake, options);
  const Frames frames;
  estimator.EstimateInitial(frames.reference(), frames.sources(), kRange);
  EXPECT_THAT(fake.calls, ElementsAre("photometric", "planar prior"));
  for (const PlaneHypothesis& plane : fake.last_prior) ASSERT_EQ(plane.d, 0);
}

TEST(DepthEstimatorTest, RefinementReadsTheGivenDepthsAndStart) {
  FakePatchMatch fake;
  DepthEstimator estimator(&fake, MakePreset("acmp"));
  const Frames frames;
  const DepthMap first(40, 30, 4.0f), third(30, 26, 5.0f);
  PatchMatchResult start = {PlaneMap(40, 30, {0, 0, -1, 4.5f}), CostMap(40, 30), Image<uint32_t>(40, 30)};
  const PatchMatchResult result =
      estimator.RefineGeometric(frames.reference(), frames.sources(), {&first, nullptr, &third}, kRange, start, 1);
  EXPECT_THAT(fake.calls, ElementsAre("geometric 1"));
  EXPECT_EQ(fake.start_d, 4.5f);
  EXPECT_EQ(result.planes(0, 0).d, 6);
  ASSERT_EQ(fake.last_problem.sources.size(), 3u);
  EXPECT_EQ(fake.last_problem.sources[0].depth.data, first.data());
  EXPECT_TRUE(fake.last_problem.sources[1].depth.empty());
  EXPECT_EQ(fake.last_problem.sources[2].depth.data, third.data());
  EXPECT_EQ(estimator.last_times().kernels_ms, 10);
  EXPECT_EQ(estimator.last_times().photometric_ms, 0);
}

TEST(DepthEstimatorTest, RefinementNeedsOneDepthMapPerSource) {
  FakePatchMatch fake;
  DepthEstimator estimator(&fake, MakePreset("acmp"));
  const Frames frames;
  try {
    estimator.RefineGeometric(frames.reference(), frames.sources(), {nullptr, nullptr}, kRange, {}, 0);
    FAIL() << "no exception";
  } catch (const InvalidInputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("2 maps for 3 source views"));
  }
  EXPECT_TRUE(fake.calls.empty());
}

TEST(DepthEstimatorTest, BadOptionsAreRefusedAndTheOldOnesKept) {
  FakePatchMatch fake;
  PipelineOptions bad = MakePreset("acmp");
  bad.patch_match.view_draws = 0;
  EXPECT_THROW(DepthEstimator(&fake, bad), InvalidInputError);
  DepthEstimator estimator(&fake, MakePreset("acmh"));
  EXPECT_THROW(estimator.set_options(bad), InvalidInputError);
  EXPECT_FALSE(estimator.options().use_planar_prior);
  EXPECT_EQ(estimator.options().patch_match.view_draws, 15);
  estimator.set_options(MakePreset("acmp_no_geometric"));
  EXPECT_TRUE(estimator.options().use_planar_prior);
}

}  // namespace
}  // namespace acmp
