#include <tuple>
#include <utility>

#include "gmock/gmock.h"

#include "support/devices.h"
#include "support/engine_scene.h"
#include "support/pass_result.h"
#include "support/random_views.h"

// What holds for whole passes on every device, whatever the images show.

namespace acmp {
namespace {

constexpr float kMaxPhotometric = 2.0f;
constexpr float kMaxGeometric = 2.6f;  // 2 + 0.2 * min(error, 3)
constexpr DepthRange kRange = {1, 10};

/// A prior of large and small triangles at random depths; a third of them has no plane.
PriorMesh RandomPrior(const PinholeCamera& camera, uint32_t seed) {
  TestRandom random(seed);
  std::vector<SupportPoint> points;
  for (int row = 0; row < camera.height; row += 1 + random.Below(9)) {
    for (int col = random.Below(5); col < camera.width; col += 1 + random.Below(12)) {
      points.push_back({col, row, static_cast<float>(random(3, 5))});
    }
  }
  PriorMesh mesh = MakePriorMesh(camera, points, {});
  for (PlaneHypothesis& plane : mesh.planes) {
    if (random(0, 1) < 0.3) plane = {};
  }
  return mesh;
}

struct AllPasses {
  EstimateState photometric, planar_prior, grid_prior, geometric;

  bool operator==(const AllPasses& other) const {
    return SameBits(photometric, other.photometric) && SameBits(planar_prior, other.planar_prior) &&
           SameBits(grid_prior, other.grid_prior) && SameBits(geometric, other.geometric);
  }
};

AllPasses RunAll(DepthEngine* engine, const EngineProblem& problem, const PatchMatchOptions& options = {}) {
  const PriorMesh prior = RandomPrior(problem.reference.frame->camera, 77);
  const EngineEstimatePtr photometric = engine->RunPhotometric(problem, options, 0);
  const EngineEstimatePtr assisted = engine->RunPlanarPrior(problem, options, photometric, prior);
  const EngineEstimatePtr by_grid = engine->RunGridPrior(problem, options, photometric, {});
  const EngineEstimatePtr geometric = engine->RunGeometric(problem, options, assisted, 0);
  return {engine->DownloadState(photometric), engine->DownloadState(assisted), engine->DownloadState(by_grid),
          engine->DownloadState(geometric)};
}

class PassesTest : public EngineTest {
 protected:
  EngineProblem Problem(const std::vector<PlanarView>& views, const DepthRange& range = kRange,
                        bool with_depths = true) {
    return MakeEngineProblem(views, range, with_depths, engine_.get());
  }

  AllPasses ExpectAllValid(const EngineProblem& problem, const PatchMatchOptions& options = {}) {
    AllPasses all = RunAll(engine_.get(), problem, options);
    const PinholeCamera& camera = problem.reference.frame->camera;
    ExpectValid(all.photometric, camera, problem.depth_range, kMaxPhotometric);
    ExpectValid(all.planar_prior, camera, problem.depth_range, kMaxPhotometric);
    ExpectValid(all.grid_prior, camera, problem.depth_range, kMaxPhotometric);
    ExpectValid(all.geometric, camera, problem.depth_range, kMaxGeometric);
    return all;
  }

  bool Same(const EngineEstimatePtr& a, const EngineEstimatePtr& b) {
    return SameBits(engine_->DownloadState(a), engine_->DownloadState(b)) &&
           SamePixels(engine_->DownloadDepth(a), engine_->Download(b).depth);
  }
};
INSTANTIATE_TEST_SUITE_P(Devices, PassesTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(PassesTest, ResultsAreValidWhateverTheSizesAndTheNumberOfSources) {
  for (const auto& [width, height, sources] :
       {std::tuple(37, 29, 4), {64, 21, 4}, {20, 49, 4}, {25, 19, 1}, {25, 19, 2}, {25, 19, 31}, {25, 19, 32}}) {
    ExpectAllValid(Problem(RandomViews(1 + sources, width, height, 1)));
  }
  for (const auto& [width, height] : {std::pair(1, 1), {1, 9}, {7, 1}, {2, 2}, {5, 4}, {10, 3}}) {
    std::vector<PlanarView> views = RandomViews(4, 17, 15, 2);  // smaller than the window
    views[0].camera = TestCamera(width, height);
    views[0].gray = RandomImage(width, height, 3);
    views[2].camera = TestCamera(1, 1);  // a source may be tiny too
    views[2].gray = RandomImage(1, 1, 4);
    views[2].depth = DepthMap(1, 1, 4.0f);
    ExpectAllValid(Problem(views));
  }
}

TEST_P(PassesTest, ResultsAreValidWhereNoSourceSeesAnything) {
  std::vector<PlanarView> views = RandomViews(4, 33, 27, 7);
  for (size_t i = 1; i < 4; ++i) {
    views[i].cam_from_world = LookAhead({0.1, 0.0, 0.1 * static_cast<double>(i)}, 180, 0, 0);
  }
  const AllPasses all = ExpectAllValid(Problem(views));
  for (const float cost : all.photometric.cost) ASSERT_EQ(cost, 2.0f);
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
    ExpectAllValid(Problem(views), options);
    options.view_draws = 1;
    options.view_smoothness = 0.5f;
    ExpectAllValid(Problem(views, {1e-3f, 1e5f}), options);
  }
  ExpectAllValid(Problem(views, {3.0f, 3.000001f}));
}

TEST_P(PassesTest, SameInputGivesTheSameBits) {
  const std::vector<PlanarView> views = RandomViews(5, 61, 45, 9);
  const EngineProblem problem = Problem(views);
  const AllPasses first = RunAll(engine_.get(), problem);
  // Problems of other sizes and source counts in between, with depths and without: no state may survive.
  for (const auto& [width, height, count] :
       {std::tuple(40, 30, 2), {120, 90, 9}, {30, 70, 33}, {1, 1, 2}, {97, 3, 5}}) {
    const std::vector<PlanarView> others = RandomViews(count, width, height, 10);
    for (const bool with_depths : {true, false}) RunAll(engine_.get(), Problem(others, {0.5f, 5}, with_depths));
  }
  EXPECT_TRUE(RunAll(engine_.get(), problem) == first);
  EXPECT_TRUE(RunAll(engine_->Share().get(), problem) == first);
  const std::unique_ptr<DepthEngine> fresh = MakeDepthEngine(GetParam()).engine;
  EXPECT_TRUE(RunAll(fresh.get(), MakeEngineProblem(views, kRange, true, fresh.get())) == first);
}

TEST_P(PassesTest, MissingDepthMapsCountAsTruncatedEverywhere) {
  std::vector<PlanarView> views = RandomViews(3, 33, 27, 16);
  const EngineProblem none = Problem(views, kRange, false);
  const EngineEstimatePtr start = engine_->RunPhotometric(none, {}, 0);
  for (PlanarView& view : views) std::fill(view.depth.begin(), view.depth.end(), 0.0f);
  const EngineEstimatePtr result = engine_->RunGeometric(none, {}, start, 0);
  EXPECT_TRUE(Same(result, engine_->RunGeometric(Problem(views), {}, start, 0)));
  const EstimateState state = engine_->DownloadState(result);
  ExpectValid(state, views[0].camera, kRange, kMaxGeometric);
  // 0.1 * 5 px from every view, unless the pixel has none.
  for (const float cost : state.cost) ASSERT_GE(cost, 0.5f);
}

TEST_P(PassesTest, AStartThatNobodyElseHoldsGivesItsMemory) {
  const std::vector<PlanarView> views = RenderPlanarScene(WorldPlane::Slanted(30, 20, 4), 65, 49, 4);
  const EngineProblem problem = Problem(views, {2, 8});
  const EngineEstimatePtr held = engine_->RunPhotometric(problem, {}, 0);
  const auto copy = [&] { return engine_->UploadState(engine_->DownloadState(held), views[0].camera); };
  const EngineEstimatePtr original = copy();
  const PriorMesh prior = MakePriorMesh(views[0].camera, engine_->FindSupportPoints(held, {2, 8}, {}), {});
  ASSERT_GT(prior.triangles.size(), 20u);
  const auto expect_in_place = [&](const auto& run) {
    const EngineEstimatePtr expected = run(held);
    EXPECT_TRUE(Same(held, original)) << "others may still read it";
    EXPECT_FALSE(Same(expected, held));
    EngineEstimatePtr start = copy();
    const EngineEstimate* memory = start.get();
    const EngineEstimatePtr result = run(std::move(start));
    EXPECT_TRUE(Same(result, expected));
    // On the GPU the new estimate is the old one; on the CPU its planes' memory is.
    EXPECT_TRUE(GetParam() == Device::kCpu || result.get() == memory);
  };
  expect_in_place([&](EngineEstimatePtr start) { return engine_->RunGeometric(problem, {}, std::move(start), 0); });
  expect_in_place(
      [&](EngineEstimatePtr start) { return engine_->RunPlanarPrior(problem, {}, std::move(start), prior); });
  expect_in_place([&](EngineEstimatePtr start) { return engine_->RunGridPrior(problem, {}, std::move(start), {}); });
}

/// ACMM's steps at the coarsest scale and from there to the next one.
TEST_P(PassesTest, EstimatesOfALevelGuideTheNextFinerOne) {
  const std::vector<PlanarView> rendered = RenderPlanarScene(WorldPlane::Slanted(30, 20, 4), 65, 49, 4);
  const std::vector<EngineView> views = LoadViews(rendered, engine_.get(), 1);
  const auto problem_of = [&](size_t reference, const std::vector<EngineEstimatePtr>& estimates) {
    EngineProblem problem = {views[reference], {}, {2, 8}};
    for (size_t i = 0; i < views.size(); ++i) {
      if (i == reference) continue;
      problem.sources.push_back(views[i]);
      if (!estimates.empty()) problem.sources.back().estimate = estimates[i];
    }
    return problem;
  };
  PatchMatchOptions options;
  options.method = Method::kAcmh;
  std::vector<EngineEstimatePtr> full, coarse;
  for (size_t i = 0; i < views.size(); ++i) {
    full.push_back(engine_->RunPhotometric(problem_of(i, {}), options, 0));
    coarse.push_back(engine_->RunPhotometric(problem_of(i, {}), options, 1));
  }
  EXPECT_THROW(engine_->RunGeometric(problem_of(0, full), options, coarse[0], 0), InvalidInputError)
      << "sources of another level";
  const EngineEstimatePtr refined = engine_->RunGeometric(problem_of(0, coarse), options, coarse[0], 0);
  ExpectValid(engine_->DownloadState(refined), rendered[0].camera.Halved(), {2, 8}, kMaxGeometric);
  EXPECT_FALSE(Same(refined, coarse[0]));

  const EngineEstimatePtr guided = engine_->RestoreDetails(problem_of(0, {}), options, full[0], refined);
  const EstimateState own = engine_->DownloadState(full[0]), mixed = engine_->DownloadState(guided);
  ExpectValid(mixed, rendered[0].camera, {2, 8}, kMaxPhotometric);
  size_t kept = 0;
  for (size_t i = 0; i < own.planes.size(); ++i) {
    kept += own.planes.data()[i].d == mixed.planes.data()[i].d ? 1 : 0;
  }
  EXPECT_GT(kept, 0u);
  EXPECT_LT(kept, own.planes.size() / 2);
  EXPECT_GT(ShareWithin(engine_->DownloadDepth(guided), rendered[0].depth, 0.05),
            0.9 * ShareWithin(engine_->DownloadDepth(full[0]), rendered[0].depth, 0.05))
      << "on a plane the coarser scale is not much worse";
  EXPECT_THROW(engine_->RestoreDetails(problem_of(0, {}), options, full[0], full[0]), InvalidInputError);
}

}  // namespace
}  // namespace acmp
