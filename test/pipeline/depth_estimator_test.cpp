#include <map>
#include <string>

#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/pipeline/presets.h"
#include "support/error_text.h"
#include "support/fake_engine.h"
#include "support/planar_scene.h"

namespace acmp {
namespace {

/// Remembers what it was asked and returns a slanted plane with credible and other pixels.
class SpyEngine final : public FakeEngine {
 public:
  EngineEstimatePtr RemoveUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override {
    calls.emplace_back("free space");
    return FakeEngine::RemoveUnsupported(problem, std::move(start));
  }

  std::vector<std::string> calls;
  std::vector<PinholeCamera> cameras;  ///< of their references, of the level
  PatchMatchOptions last_options;
  EstimateState last_start;
  PriorMesh last_prior;
  Image<uint32_t> last_numbers;  ///< of its triangles

 private:
  EstimateState Answer(const PassRequest& request) override {
    cameras.push_back(request.camera());
    last_options = request.options;
    if (request.start) last_start = DownloadState(request.start);
    switch (request.pass) {
      case Pass::kPhotometric:
        calls.emplace_back("photometric");
        return Result(request.camera(), {0, -0.6f, -0.8f, 3.2f});
      case Pass::kPlanarPrior:
        calls.emplace_back("planar prior");
        last_prior = request.prior != nullptr ? *request.prior : PriorMesh();
        if (request.grid_prior != nullptr) {
          last_prior = MakeGridMesh(request.camera(), DownloadDepth(request.start), last_start.cost.View(),
                                    request.problem.depth_range, *request.grid_prior);
        }
        last_numbers = RasterizePrior(request.camera(), last_prior, request.problem.depth_range);
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

/// Number of pixels with a prior, each with the plane of the fake's photometric pass.
int CountPriorsOnThePlane(const PriorMesh& prior, const Image<uint32_t>& numbers) {
  int with_prior = 0;
  for (const uint32_t number : numbers) {
    if (number == 0) continue;
    ++with_prior;
    const PlaneHypothesis& plane = prior.planes.at(number - 1);
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
  ASSERT_EQ(engine_.last_numbers.width(), 40);
  ASSERT_EQ(engine_.last_numbers.height(), 30);
  EXPECT_GT(CountPriorsOnThePlane(engine_.last_prior, engine_.last_numbers), 0.6 * 40 * 30);
}

TEST_F(DepthEstimatorTest, FullSizeIterationsFollowAStartLevelAndThePriorPassTheseWithOptionsOfItsOwn) {
  PipelineOptions options = MakePreset("acmh");
  options.start_level = 1;
  options.full_size_iterations = 4;
  DepthEstimator estimator(&engine_, options);
  estimator.Run(estimator.schedule().front(), Problem(1));
  ASSERT_THAT(engine_.calls, ElementsAre("photometric", "planar prior"));
  EXPECT_TRUE(engine_.cameras[1] == frames_[0]->camera);
  EXPECT_EQ(engine_.last_options.planar_prior_iterations, 4);
  EXPECT_NE(engine_.last_options.seed, options.patch_match.seed);
  for (const uint32_t number : engine_.last_numbers) ASSERT_EQ(number, 0u);
  ASSERT_EQ(engine_.last_start.planes.width(), 40);
  EXPECT_EQ(engine_.last_start.planes(0, 0).d, 3.2f);  // the upsampled ones
  EXPECT_EQ(estimator.last_times().photometric_kernels_ms, 20);
  EXPECT_EQ(estimator.last_times().kernels_ms, 20);

  engine_.calls.clear();
  options.use_planar_prior = true;
  estimator.set_options(options);
  estimator.Run(estimator.schedule().front(), Problem(1));
  EXPECT_THAT(engine_.calls, ElementsAre("photometric", "planar prior", "planar prior"));
  EXPECT_EQ(engine_.last_options.planar_prior_iterations, options.patch_match.planar_prior_iterations);
  EXPECT_EQ(engine_.last_options.seed, options.patch_match.seed);
  EXPECT_EQ(engine_.last_start.planes(0, 0).d, 5);  // of the full-size iterations
  EXPECT_EQ(estimator.last_times().kernels_ms, 30);
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

TEST(PresetsTest, AreThePapersSystemsAndOurs) {
  EXPECT_THAT(PresetNames(), ElementsAre("acmh", "acmm", "acmp_no_geometric", "acmp", "balanced", "online"));
  for (const std::string& name : PresetNames()) EXPECT_NO_THROW(Validate(MakePreset(name))) << name;
  EXPECT_REFUSED(MakePreset("ACMP"), "\"ACMP\"", "acmh, acmm, acmp_no_geometric, acmp, balanced, online");
}

TEST(PresetsTest, ThePapersRunTheStepsOfTheirPapersAndNothingElse) {
  const PipelineOptions acmh = MakePreset("acmh"), acmm = MakePreset("acmm"), acmp = MakePreset("acmp"),
                        no_geometric = MakePreset("acmp_no_geometric");
  EXPECT_EQ(acmh.patch_match.method, Method::kAcmh);
  EXPECT_TRUE(!acmh.use_planar_prior && no_geometric.use_planar_prior && acmp.use_planar_prior);
  EXPECT_THAT(std::vector<int>(
                  {acmh.geometric_passes, no_geometric.geometric_passes, acmp.geometric_passes, acmm.geometric_passes}),
              ElementsAre(0, 0, 2, 2));
  EXPECT_EQ(acmm.patch_match.geometric_weight, 0.2f);
  EXPECT_EQ(acmm.patch_match.geometric_max_px, 3.0f);
  for (const PipelineOptions& later : {no_geometric, acmp}) {
    // Section "Experiments", parameter settings; section "The Algorithm".
    const PatchMatchOptions& match = later.patch_match;
    EXPECT_EQ(match.method, Method::kAcmp);
    EXPECT_EQ(later.planar_prior.max_support_cost, 0.1f);
    EXPECT_EQ(match.prior_alpha, 0.18f);
    EXPECT_EQ(match.prior_gamma, 0.5f);
    EXPECT_EQ(match.prior_sigma_normal_deg, 5.0f);
    EXPECT_EQ(match.prior_depth_divisor, 64.0f);
    EXPECT_EQ(match.sigma_view, 0.3f);
    EXPECT_EQ(match.view_smoothness, 0.9f);
    EXPECT_EQ(match.geometric_weight, 0.1f);
    EXPECT_EQ(match.geometric_max_px, 5.0f);
    EXPECT_EQ(match.photometric_iterations, 3);
    EXPECT_EQ(match.planar_prior_iterations, 3);
    EXPECT_EQ(match.geometric_iterations, 2);
    EXPECT_EQ(later.planar_prior.cell_size_px, 5);
  }
  for (const PipelineOptions& paper : {acmh, no_geometric, acmp}) {
    EXPECT_EQ(paper.start_level, 0);
    EXPECT_EQ(paper.full_size_iterations, 0);
    EXPECT_FALSE(paper.fill.enabled);
    EXPECT_EQ(paper.fusion.max_reprojection_px, 2.0f);
    EXPECT_EQ(paper.fusion.max_relative_depth, 0.01f);
    EXPECT_EQ(paper.fusion.max_normal_angle_deg, 10.0f);
    EXPECT_EQ(paper.fusion.min_consistent_views, 2);
    EXPECT_EQ(paper.fusion.min_confidence, 0);
  }
}

/// A bound of the option, or the other value of a flag.
OptionValue Extreme(const Option& option, bool upper) {
  const double bound = upper ? option.max : option.min;
  if (std::holds_alternative<bool>(option.get())) return upper;
  if (std::holds_alternative<int>(option.get())) return static_cast<int>(bound);
  return bound;
}

TEST(ParametersTest, SettingOneChangesThatOneAlone) {
  PipelineOptions options, defaults;
  const OptionList of_defaults = OptionsOf(&defaults);
  for (const Option& changed : OptionsOf(&options)) {
    options = {};
    const bool at_top = changed.get() == Extreme(changed, true);
    changed.set(Extreme(changed, !at_top));
    for (const Option& option : OptionsOf(&options)) {
      EXPECT_EQ(option.get() == of_defaults.Find(option.name).get(), option.name != changed.name)
          << changed.name << ", " << option.name;
    }
  }
}

std::string StepsOf(const PipelineOptions& options) {
  using Kind = KeyframeStep::Kind;
  const std::map<Kind, std::string> names = {{Kind::kInitial, "initial"},
                                             {Kind::kNextScale, "next scale"},
                                             {Kind::kFillForPasses, "fill for passes"},
                                             {Kind::kGeometricPass, "pass"},
                                             {Kind::kFillUnverified, "fill"}};
  std::string steps;
  for (const KeyframeStep& step : ScheduleOf(options)) {
    steps += (steps.empty() ? "" : ", ") + names.at(step.kind);
    if (step.kind == Kind::kGeometricPass) steps += Concat(" ", step.pass);
    if (step.level > 0) steps += Concat(" at level ", step.level);
  }
  return steps;
}

std::string StepsOf(bool fills, int geometric_passes) {
  PipelineOptions options;
  options.fill.enabled = fills;
  options.geometric_passes = geometric_passes;
  return StepsOf(options);
}

TEST(ScheduleTest, PassesFollowTheInitialEstimateAndWhatIsUnverifiedIsFilledBeforeAndAfterThem) {
  EXPECT_EQ(StepsOf(false, 0), "initial");
  EXPECT_EQ(StepsOf(false, 2), "initial, pass 0, pass 1");
  EXPECT_EQ(StepsOf(true, 0), "initial, fill") << "nothing checks what would be offered to passes";
  EXPECT_EQ(StepsOf(true, 2), "initial, fill for passes, pass 0, pass 1, fill");
  EXPECT_EQ(StepsOf(MakePreset("acmm")),
            "initial at level 2, pass 0 at level 2, pass 1 at level 2, "
            "next scale at level 1, pass 0 at level 1, pass 1 at level 1, next scale, pass 0, pass 1");
}

}  // namespace
}  // namespace acmp
