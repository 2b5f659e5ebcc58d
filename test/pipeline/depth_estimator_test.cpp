#include "acmp_mapping/pipeline/depth_estimator.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/host_depth_engine.h"
#include "acmp_mapping/image/cells.h"
#include "support/planar_scene.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

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
    last_start = start.Clone();
    last_prior = PlaneMap(prior.width, prior.height);
    for (int row = 0; row < prior.height; ++row) {
      for (int col = 0; col < prior.width; ++col) last_prior(col, row) = prior(col, row);
    }
    return Result(problem, {0, 0, -1, 5});
  }
  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                const PatchMatchResult& start, int pass) override {
    Note(Concat("geometric ", pass), problem, options);
    last_start = start.Clone();
    return Result(problem, {0, 0, -1, 6});
  }
  Image<float> MeasureEvidence(const PatchMatchProblem&, const PlaneMap& planes, int cell_size) override {
    calls.emplace_back("evidence");
    return Image<float>(CellsOf(planes.width(), cell_size), CellsOf(planes.height(), cell_size));
  }
  PatchMatchTiming last_timing() const override { return {1, 10, 1}; }
  std::string device_name() const override { return "fake"; }

  std::vector<std::string> calls;
  std::vector<PatchMatchProblem> problems;  ///< of the calls; their pixels belong to the caller
  PatchMatchOptions last_options;
  PlaneMap last_prior;
  PatchMatchResult last_start;

 private:
  void Note(const std::string& name, const PatchMatchProblem& problem, const PatchMatchOptions& options) {
    calls.push_back(name);
    Check(problem);  // so the images have the size of their cameras
    problems.push_back(problem);
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

constexpr DepthRange kRange = {1, 10};

/// An image without two equal neighbours, so that the means of any four pixels differ from the pixels.
ColorImage Pattern(int width, int height, int offset) {
  ColorImage image(width, height);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      const auto value = static_cast<unsigned char>(37 * col + 101 * row + offset);
      image(col, row) = {value, value, value};
    }
  }
  return image;
}

/// An estimator over the fake, a reference frame of 40 x 30 pixels and three sources, the last of 30 x 26.
class DepthEstimatorTest : public ::testing::Test {
 protected:
  DepthEstimatorTest() {
    for (int i = 0; i < 4; ++i) {
      const PinholeCamera camera = i == 3 ? TestCamera(30, 26) : TestCamera(40, 30);
      frames_.push_back(std::make_shared<const Frame>(
          MakeFrame(i, 0, Pattern(camera.width, camera.height, i), camera, LookAhead({0.2 * i, 0, 0}, 0, 0, 0), {})));
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

  FakePatchMatch fake_;
  HostDepthEngine engine_{&fake_};
  std::vector<FramePtr> frames_;
};

TEST_F(DepthEstimatorTest, WithoutPriorRunsThePhotometricPassOnly) {
  DepthEstimator estimator(&engine_, MakePreset("acmh"));
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem());
  EXPECT_THAT(fake_.calls, ElementsAre("photometric"));
  EXPECT_EQ(FirstPlane(estimate).d, 3.2f);
  EXPECT_EQ(estimator.last_times().kernels_ms, 10);
  EXPECT_EQ(estimator.last_times().planar_prior_ms, 0);
}

TEST_F(DepthEstimatorTest, HandsOverViewsInOrderWithTheirCameras) {
  PipelineOptions options = MakePreset("acmh");
  options.patch_match.seed = 17;
  DepthEstimator estimator(&engine_, options);
  EngineProblem problem = Problem();
  problem.sources[0].estimate = EstimateAt(4, 40, 30);  // not for this pass
  estimator.Run(estimator.schedule().front(), problem);
  EXPECT_EQ(fake_.last_options.seed, 17u);
  const PatchMatchProblem& seen = fake_.problems.at(0);
  EXPECT_EQ(seen.depth_range.min, 1);
  EXPECT_EQ(seen.depth_range.max, 10);
  EXPECT_EQ(seen.reference.gray.data, frames_[0]->gray.data());
  ASSERT_EQ(seen.sources.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const Frame& expected = *problem.sources[i].frame;
    const MatchView& view = seen.sources[i];
    EXPECT_EQ(view.gray.data, expected.gray.data());
    EXPECT_TRUE(view.camera == expected.camera);
    EXPECT_EQ((view.cam_from_world.matrix() - expected.cam_from_world.matrix()).norm(), 0);
    EXPECT_TRUE(view.depth.empty());
  }
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
  EXPECT_THAT(fake_.calls, ElementsAre("photometric", "planar prior"));  // the geometric passes are asked for apart
  EXPECT_EQ(fake_.last_start.planes(0, 0).d, 3.2f);
  EXPECT_EQ(FirstPlane(estimate).d, 5);
  EXPECT_EQ(estimator.last_times().kernels_ms, 20);
  EXPECT_EQ(estimator.last_times().photometric_kernels_ms, 10);
  // All credible pixels lie on one plane, so every triangle has that plane; only the rim lies outside all triangles.
  ASSERT_EQ(fake_.last_prior.width(), 40);
  ASSERT_EQ(fake_.last_prior.height(), 30);
  EXPECT_GT(CountPriorsOnThePlane(fake_.last_prior), 0.6 * 40 * 30);
}

TEST_F(DepthEstimatorTest, WithoutSupportThePriorIsEmptyAndThePassStillRuns) {
  PipelineOptions options = MakePreset("balanced");
  options.planar_prior.max_support_cost = 0.01f;  // no pixel is that good
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem());
  EXPECT_THAT(fake_.calls, ElementsAre("photometric", "planar prior"));
  for (const PlaneHypothesis& plane : fake_.last_prior) ASSERT_EQ(plane.d, 0);
}

TEST_F(DepthEstimatorTest, PhotometricPassOfAStartLevelSeesHalvedImages) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  DepthEstimator estimator(&engine_, options);
  const EngineProblem problem = Problem(1);
  estimator.Run(estimator.schedule().front(), problem);
  ASSERT_THAT(fake_.calls, ElementsAre("photometric", "planar prior"));
  EXPECT_EQ(estimator.last_times().kernels_ms, 20);
  const auto expect_halved = [](const MatchView& view, const Frame& frame) {
    EXPECT_TRUE(view.camera == frame.camera.Halved());
    ASSERT_EQ(view.gray.width, frame.camera.width / 2);
    for (const auto& [col, row] : {std::pair(0, 0), {7, 9}, {view.gray.width - 1, view.gray.height - 1}}) {
      const GrayImage& gray = frame.gray;
      EXPECT_FLOAT_EQ(view.gray(col, row), (gray(2 * col, 2 * row) + gray(2 * col + 1, 2 * row) +
                                            gray(2 * col, 2 * row + 1) + gray(2 * col + 1, 2 * row + 1)) /
                                               4);
    }
  };
  const PatchMatchProblem& photometric = fake_.problems[0];
  expect_halved(photometric.reference, *frames_[0]);
  ASSERT_EQ(photometric.sources.size(), 3u);
  for (size_t i = 0; i < 3; ++i) expect_halved(photometric.sources[i], *problem.sources[i].frame);

  const PatchMatchProblem& prior = fake_.problems[1];
  EXPECT_TRUE(prior.reference.camera == frames_[0]->camera);
  EXPECT_EQ(prior.reference.gray.data, frames_[0]->gray.data());
  EXPECT_TRUE(prior.sources[2].camera == frames_[3]->camera);
}

TEST_F(DepthEstimatorTest, PlanarPriorPassOfAStartLevelBeginsWithUpsampledPlanes) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  DepthEstimator estimator(&engine_, options);
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem(1));
  EXPECT_EQ(engine_.DownloadState(estimate).planes.width(), 40);
  const PatchMatchResult& start = fake_.last_start;
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
  const PlaneMap& prior = fake_.last_prior;
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
  ASSERT_THAT(fake_.calls, ElementsAre("photometric", "planar prior"));
  EXPECT_TRUE(fake_.problems[1].reference.camera == frames_[0]->camera);
  EXPECT_EQ(fake_.last_options.planar_prior_iterations, 4);
  EXPECT_NE(fake_.last_options.seed, options.patch_match.seed);
  for (const PlaneHypothesis& plane : fake_.last_prior) ASSERT_EQ(plane.d, 0);
  ASSERT_EQ(fake_.last_start.planes.width(), 40);
  EXPECT_EQ(fake_.last_start.planes(0, 0).d, 3.2f);  // the upsampled ones
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
  EXPECT_THAT(fake_.calls, ElementsAre("photometric", "planar prior", "planar prior"));
  EXPECT_EQ(fake_.last_options.planar_prior_iterations, options.patch_match.planar_prior_iterations);
  EXPECT_EQ(fake_.last_options.seed, options.patch_match.seed);
  EXPECT_EQ(fake_.last_start.planes(0, 0).d, 5);  // of the full-size iterations
  EXPECT_EQ(estimator.last_times().photometric_kernels_ms, 20);
  EXPECT_EQ(estimator.last_times().kernels_ms, 30);
}

TEST_F(DepthEstimatorTest, WithoutAStartLevelThereAreNoFullSizeIterations) {
  PipelineOptions options = MakePreset("acmh");
  options.full_size_iterations = 4;
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem());
  EXPECT_THAT(fake_.calls, ElementsAre("photometric"));
}

TEST_F(DepthEstimatorTest, WithoutPriorAStartLevelStillGivesTheFullSize) {
  PipelineOptions options = MakePreset("acmh");
  options.start_level = 2;
  DepthEstimator estimator(&engine_, options);
  const EngineEstimatePtr estimate = estimator.Run(estimator.schedule().front(), Problem(2));
  EXPECT_THAT(fake_.calls, ElementsAre("photometric"));
  EXPECT_EQ(fake_.problems[0].reference.camera.width, 10);
  EXPECT_EQ(fake_.problems[0].sources[2].camera.height, 6);
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
  EXPECT_THAT(fake_.calls, ElementsAre("geometric 1"));
  EXPECT_EQ(fake_.last_start.planes(0, 0).d, 4.5f);
  EXPECT_EQ(FirstPlane(refined).d, 6);
  const PatchMatchProblem& seen = fake_.problems.at(0);
  ASSERT_EQ(seen.sources.size(), 3u);
  EXPECT_EQ(seen.sources[0].depth(3, 2), 4);
  EXPECT_TRUE(seen.sources[1].depth.empty());
  EXPECT_EQ(seen.sources[2].depth.width, 30);
  EXPECT_EQ(seen.sources[2].depth(29, 25), 5);
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
  EXPECT_THAT(fake_.calls, ElementsAre("geometric 0", "geometric 1", "evidence"));

  fake_.calls.clear();
  options.fill.remove_unsupported = false;
  estimator.set_options(options);
  estimator.Run(estimator.schedule().back(), problem);
  EXPECT_THAT(fake_.calls, IsEmpty());
}

TEST_F(DepthEstimatorTest, RefinementIsAtFullSizeWhateverTheStartLevel) {
  PipelineOptions options = MakePreset("balanced");
  options.start_level = 1;
  DepthEstimator estimator(&engine_, options);
  EngineProblem problem = Problem(1);
  problem.reference.estimate = EstimateAt(4.5f, 40, 30);
  estimator.Run(estimator.schedule().at(2), problem);
  EXPECT_TRUE(fake_.problems.at(0).reference.camera == frames_[0]->camera);
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
