#include "acmp_mapping/pipeline/depth_estimator.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "support/fake_engine.h"
#include "support/planar_scene.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// Remembers what it was asked and returns a slanted plane with credible and other pixels.
class SpyEngine final : public FakeEngine {
 public:
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override {
    calls.emplace_back("free space");
    return FakeEngine::RemoveUnsupported(problem, std::move(start));
  }

  std::vector<std::string> calls;
  std::vector<EngineProblem> problems;  ///< of the passes
  std::vector<PinholeCamera> cameras;   ///< of their references, of the level
  PatchMatchOptions last_options;
  EstimateState last_start;
  PlaneMap last_prior;

 private:
  EstimateState Answer(const PassRequest& request) override {
    problems.push_back(request.problem);
    cameras.push_back(request.camera());
    last_options = request.options;
    if (request.start) last_start = DownloadState(request.start);
    switch (request.pass) {
      case Pass::kPhotometric:
        calls.emplace_back("photometric");
        return Result(request.camera(), {0, -0.6f, -0.8f, 3.2f});
      case Pass::kPlanarPrior:
        calls.emplace_back("planar prior");
        last_prior = RasterizePrior(request.camera(), *request.prior, request.problem.depth_range);
        return Result(request.camera(), {0, 0, -1, 5});
      default:
        calls.push_back(Concat("geometric ", request.geometric_pass));
        return Result(request.camera(), {0, 0, -1, 6});
    }
  }
  static EstimateState Result(const PinholeCamera& camera, const PlaneHypothesis& plane) {
    // A third of the pixels is credible (cost below 0.1), in every 5 x 5 cell.
    EstimateState state = UniformState(camera, plane, 0.5f);
    for (int row = 0; row < camera.height; ++row) {
      for (int col = row % 3; col < camera.width; col += 3) state.cost(col, row) = 0.05f;
    }
    return state;
  }
};

constexpr DepthRange kRange = {1, 10};

/// An estimator over the fake, a reference frame of 40 x 30 pixels and three sources, the last of 30 x 26.
class DepthEstimatorTest : public ::testing::Test {
 protected:
  DepthEstimatorTest() {
    for (int i = 0; i < 4; ++i) {
      const PinholeCamera camera = i == 3 ? TestCamera(30, 26) : TestCamera(40, 30);
      frames_.push_back(std::make_shared<const Frame>(
          MakeFrame(i, 0, ColorImage(camera.width, camera.height), camera, LookAhead({0.2 * i, 0, 0}, 0, 0, 0), {})));
    }
  }

  EngineView View(int index, int levels) {
    return {frames_[static_cast<size_t>(index)], engine_.Load(frames_[static_cast<size_t>(index)], levels), nullptr};
  }
  /// Frame 0 against 2, 1 and 3.
  EngineProblem Problem(int levels = 0) {
    return {View(0, levels), {View(2, levels), View(1, levels), View(3, levels)}, kRange};
  }
  /// An estimate whose planes face the camera at one depth.
  EngineEstimatePtr EstimateAt(float depth, int width, int height) {
    return engine_.UploadState({PlaneMap(width, height, {0, 0, -1, depth}), CostMap(width, height)},
                               TestCamera(width, height));
  }
  PlaneHypothesis FirstPlane(const EngineEstimatePtr& estimate) { return engine_.DownloadState(estimate).planes(0, 0); }

  SpyEngine engine_;
  std::vector<FramePtr> frames_;
};

TEST_F(DepthEstimatorTest, WithoutPriorRunsThePhotometricPassOnly) {
  DepthEstimator estimator(&engine_, MakePreset("acmh"));
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem());
  EXPECT_THAT(engine_.calls, ElementsAre("photometric"));
  EXPECT_EQ(FirstPlane(estimate).d, 3.2f);
  EXPECT_EQ(estimator.last_times().kernels_ms, 10);
  EXPECT_EQ(estimator.last_times().planar_prior_ms, 0);
}

TEST_F(DepthEstimatorTest, HandsOverViewsInOrder) {
  PipelineOptions options = MakePreset("acmh");
  options.patch_match.seed = 17;
  DepthEstimator estimator(&engine_, options);
  const EngineProblem problem = Problem();
  estimator.Run(estimator.schedule().front(), problem);
  EXPECT_EQ(engine_.last_options.seed, 17u);
  const EngineProblem& seen = engine_.problems.at(0);
  EXPECT_EQ(seen.depth_range.min, 1);
  EXPECT_EQ(seen.depth_range.max, 10);
  EXPECT_EQ(seen.reference.frame, frames_[0]);
  ASSERT_EQ(seen.sources.size(), 3u);
  for (size_t i = 0; i < 3; ++i) EXPECT_EQ(seen.sources[i].frame, problem.sources[i].frame);
}

/// Number of pixels with a prior, each with the plane of the fake's photometric pass.
int CountPriorsOnThePlane(const PlaneMap& prior) {
  int with_prior = 0;
  for (const PlaneHypothesis& plane : prior) {
    if (!(plane.d > 0)) continue;
    ++with_prior;
    // Triangles down to 5 px across at depth 4: rounding of depths to 1e-7 over about 0.6 m.
    EXPECT_NEAR(plane.nx, 0, 1e-4);
    EXPECT_NEAR(plane.ny, -0.6, 1e-4);
    EXPECT_NEAR(plane.nz, -0.8, 1e-4);
    EXPECT_NEAR(plane.d, 3.2, 1e-3);
  }
  return with_prior;
}

TEST_F(DepthEstimatorTest, PriorComesFromTheCrediblePixelsOfThePhotometricPass) {
  DepthEstimator estimator(&engine_, MakePreset("balanced"));
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem());
  EXPECT_THAT(engine_.calls, ElementsAre("photometric", "planar prior"));  // the geometric passes are asked for apart
  EXPECT_EQ(engine_.last_start.planes(0, 0).d, 3.2f);
  EXPECT_EQ(FirstPlane(estimate).d, 5);
  EXPECT_EQ(estimator.last_times().kernels_ms, 20);
  EXPECT_EQ(estimator.last_times().photometric_kernels_ms, 10);
  // All credible pixels lie on one plane, so every triangle has that plane; only the rim lies outside all triangles.
  ASSERT_EQ(engine_.last_prior.width(), 40);
  ASSERT_EQ(engine_.last_prior.height(), 30);
  EXPECT_GT(CountPriorsOnThePlane(engine_.last_prior), 0.6 * 40 * 30);
}

TEST_F(DepthEstimatorTest, WithoutSupportThePriorIsEmptyAndThePassStillRuns) {
  PipelineOptions options = MakePreset("balanced");
  options.planar_prior.max_support_cost = 0.01f;  // no pixel is that good
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem());
  EXPECT_THAT(engine_.calls, ElementsAre("photometric", "planar prior"));
  for (const PlaneHypothesis& plane : engine_.last_prior) ASSERT_EQ(plane.d, 0);
}

TEST_F(DepthEstimatorTest, PhotometricPassOfAStartLevelSeesHalvedImages) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem(1));
  ASSERT_THAT(engine_.calls, ElementsAre("photometric", "planar prior"));
  EXPECT_EQ(estimator.last_times().kernels_ms, 20);
  EXPECT_TRUE(engine_.cameras[0] == frames_[0]->camera.Halved());
  EXPECT_TRUE(engine_.cameras[1] == frames_[0]->camera);
}

TEST_F(DepthEstimatorTest, PlanarPriorPassOfAStartLevelBeginsWithUpsampledPlanes) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  DepthEstimator estimator(&engine_, options);
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem(1));
  EXPECT_EQ(engine_.DownloadState(estimate).planes.width(), 40);
  const EstimateState& start = engine_.last_start;
  ASSERT_EQ(start.planes.width(), 40);
  ASSERT_EQ(start.planes.height(), 30);
  for (int row = 0; row < 30; ++row) {
    for (int col = 0; col < 40; ++col) {
      ASSERT_EQ(start.planes(col, row).d, 3.2f);
      const bool credible = (col / 2) % 3 == (row / 2) % 3;  // as the fake answered for the halved image
      ASSERT_EQ(start.cost(col, row), credible ? 0.05f : 0.5f) << col << ", " << row;
    }
  }
}

TEST_F(DepthEstimatorTest, PriorOfAStartLevelComesFromTheUpsampledEstimate) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem(1));
  const PlaneMap& prior = engine_.last_prior;
  ASSERT_EQ(prior.width(), 40);
  ASSERT_EQ(prior.height(), 30);
  // The plane is the one that the halved camera saw, back-projected through the full camera: as dense as without a
  // start level.
  EXPECT_GT(CountPriorsOnThePlane(prior), 0.6 * 40 * 30);
  // Support points of the halved image would end at column 34 and row 20.
  const auto has_prior = [&](int col, int row) { return prior(col, row).d > 0; };
  EXPECT_TRUE(has_prior(36, 12));
  EXPECT_TRUE(has_prior(20, 24));
}

TEST_F(DepthEstimatorTest, FullSizeIterationsFollowAStartLevelWithoutPrior) {
  PipelineOptions options = MakePreset("acmh");
  options.start_level = 1;
  options.full_size_iterations = 4;
  DepthEstimator estimator(&engine_, options);
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem(1));
  ASSERT_THAT(engine_.calls, ElementsAre("photometric", "planar prior"));
  EXPECT_TRUE(engine_.cameras[1] == frames_[0]->camera);
  EXPECT_EQ(engine_.last_options.planar_prior_iterations, 4);
  EXPECT_NE(engine_.last_options.seed, options.patch_match.seed);
  for (const PlaneHypothesis& plane : engine_.last_prior) ASSERT_EQ(plane.d, 0);
  ASSERT_EQ(engine_.last_start.planes.width(), 40);
  EXPECT_EQ(engine_.last_start.planes(0, 0).d, 3.2f);  // the upsampled ones
  EXPECT_EQ(FirstPlane(estimate).d, 5);
  EXPECT_EQ(estimator.last_times().photometric_kernels_ms, 20);
  EXPECT_EQ(estimator.last_times().kernels_ms, 20);
}

TEST_F(DepthEstimatorTest, PlanarPriorPassFollowsTheFullSizeIterationsWithOptionsOfItsOwn) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  options.full_size_iterations = 4;
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem(1));
  EXPECT_THAT(engine_.calls, ElementsAre("photometric", "planar prior", "planar prior"));
  EXPECT_EQ(engine_.last_options.planar_prior_iterations, options.patch_match.planar_prior_iterations);
  EXPECT_EQ(engine_.last_options.seed, options.patch_match.seed);
  EXPECT_EQ(engine_.last_start.planes(0, 0).d, 5);  // of the full-size iterations
  EXPECT_EQ(estimator.last_times().photometric_kernels_ms, 20);
  EXPECT_EQ(estimator.last_times().kernels_ms, 30);
}

TEST_F(DepthEstimatorTest, WithoutAStartLevelThereAreNoFullSizeIterations) {
  PipelineOptions options = MakePreset("acmh");
  options.full_size_iterations = 4;
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem());
  EXPECT_THAT(engine_.calls, ElementsAre("photometric"));
}

TEST_F(DepthEstimatorTest, WithoutPriorAStartLevelStillGivesTheFullSize) {
  PipelineOptions options = MakePreset("acmh");
  options.start_level = 2;
  DepthEstimator estimator(&engine_, options);
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem(2));
  EXPECT_THAT(engine_.calls, ElementsAre("photometric"));
  EXPECT_EQ(engine_.cameras[0].width, 10);
  const EstimateMaps maps = engine_.Download(estimate);
  EXPECT_EQ(maps.depth.width(), 40);
  EXPECT_EQ(maps.cost.height(), 30);
}

TEST_F(DepthEstimatorTest, RefinementReadsTheGivenEstimatesAndStart) {
  DepthEstimator estimator(&engine_, MakePreset("balanced"));
  EngineProblem problem = Problem();
  problem.sources[0].estimate = EstimateAt(4, 40, 30);
  problem.sources[2].estimate = EstimateAt(5, 30, 26);
  problem.reference.estimate = EstimateAt(4.5f, 40, 30);
  const EngineEstimatePtr refined = estimator.Run(estimator.schedule().at(3), problem);
  EXPECT_THAT(engine_.calls, ElementsAre("geometric 1"));
  EXPECT_EQ(engine_.last_start.planes(0, 0).d, 4.5f);
  EXPECT_EQ(FirstPlane(refined).d, 6);
  const EngineProblem& seen = engine_.problems.at(0);
  ASSERT_EQ(seen.sources.size(), 3u);
  for (size_t i = 0; i < 3; ++i) EXPECT_EQ(seen.sources[i].estimate, problem.sources[i].estimate);
  EXPECT_EQ(estimator.last_times().kernels_ms, 10);
  EXPECT_EQ(estimator.last_times().photometric_ms, 0);
}

TEST_F(DepthEstimatorTest, StepsRunThePassesThatTheOptionsName) {
  PipelineOptions options = MakePreset("balanced");
  DepthEstimator estimator(&engine_, options);
  std::vector<float> kernels_ms;
  EngineProblem problem = Problem();
  problem.reference.estimate = EstimateAt(4.5f, 40, 30);
  for (size_t step = 1; step < estimator.schedule().size(); ++step) {
    problem.reference.estimate = estimator.Run(estimator.schedule()[step], problem);
    kernels_ms.push_back(static_cast<float>(estimator.last_times().kernels_ms));
  }
  EXPECT_THAT(kernels_ms, ElementsAre(0, 10, 10, 10)) << "the fake says 10 of each, completion on the host nothing";
  EXPECT_THAT(engine_.calls, ElementsAre("geometric 0", "geometric 1", "free space"));

  engine_.calls.clear();
  options.fill.remove_unsupported = false;
  estimator.set_options(options);
  estimator.Run(estimator.schedule().back(), problem);
  EXPECT_THAT(engine_.calls, IsEmpty());
}

TEST_F(DepthEstimatorTest, RefinementIsAtFullSizeWhateverTheStartLevel) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  DepthEstimator estimator(&engine_, options);
  EngineProblem problem = Problem(1);
  problem.reference.estimate = EstimateAt(4.5f, 40, 30);
  estimator.Run(estimator.schedule().at(2), problem);
  EXPECT_TRUE(engine_.cameras.at(0) == frames_[0]->camera);
}

TEST_F(DepthEstimatorTest, BadOptionsAreRefusedAndTheOldOnesKept) {
  PipelineOptions bad = MakePreset("balanced");
  bad.patch_match.view_draws = 0;
  EXPECT_THROW(DepthEstimator(&engine_, bad), InvalidInputError);
  EXPECT_THROW(DepthEstimator(nullptr, MakePreset("acmh")), InvalidInputError);
  DepthEstimator estimator(&engine_, MakePreset("acmh"));
  EXPECT_THROW(estimator.set_options(bad), InvalidInputError);
  EXPECT_FALSE(estimator.options().use_planar_prior);
  EXPECT_EQ(estimator.options().patch_match.view_draws, 15);
  estimator.set_options(MakePreset("acmp_no_geometric"));
  EXPECT_TRUE(estimator.options().use_planar_prior);
}

TEST(StageTimesTest, AddUp) {
  StageTimes times = {1, 2, 3, 4, 5, 6, 7};
  times += {10, 20, 30, 40, 50, 60, 70};
  EXPECT_EQ(times.photometric_ms, 11);
  EXPECT_EQ(times.prior_construction_ms, 22);
  EXPECT_EQ(times.planar_prior_ms, 33);
  EXPECT_EQ(times.geometric_ms, 44);
  EXPECT_EQ(times.fill_ms, 55);
  EXPECT_EQ(times.kernels_ms, 66);
  EXPECT_EQ(times.photometric_kernels_ms, 77);
}

}  // namespace
}  // namespace acmp
