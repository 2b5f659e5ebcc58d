// Passes through the engines, which keep estimates where they are, against the same passes with maps from host memory.

#include <memory>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/planar_prior/planar_prior.h"
#include "support/devices.h"
#include "support/pass_result.h"
#include "support/planar_scene.h"

namespace acmp {
namespace {

const DepthRange kRange = {2, 8};

/// Four views of a slanted plane, of odd size: the halved depths have a last row and column of their own.
class EnginePassesTest : public EngineTest {
 protected:
  void SetUp() override {
    EngineTest::SetUp();
    if (IsSkipped()) return;
    patch_match_ = MakePatchMatch(GetParam()).patch_match;
    rendered_ = RenderPlanarScene(WorldPlane::Slanted(30, 20, 4), 65, 49, 4);
    options_.photometric_iterations = 1;
    for (const PlanarView& view : rendered_) {
      auto frame = std::make_shared<Frame>();
      frame->id = static_cast<int64_t>(views_.size());
      frame->camera = view.camera;
      frame->cam_from_world = view.cam_from_world;
      frame->gray = view.gray.Clone();
      views_.push_back({frame, engine_->Load(frame, 1), nullptr});
    }
    for (size_t i = 0; i < views_.size(); ++i) {
      views_[i].estimate = engine_->RunPhotometric(ProblemOf(i), options_, 0);
      depths_.push_back(engine_->Download(views_[i].estimate).depth);
    }
  }

  EngineProblem ProblemOf(size_t reference) const {
    EngineProblem problem;
    problem.reference = views_[reference];
    for (size_t i = 0; i < views_.size(); ++i) {
      if (i != reference) problem.sources.push_back(views_[i]);
    }
    problem.depth_range = kRange;
    return problem;
  }

  PatchMatchResult Start() const {
    EstimateState state = engine_->DownloadState(views_[0].estimate);
    return {std::move(state.planes), std::move(state.cost), {}};
  }

  bool IsSameAs(const EngineEstimatePtr& estimate, PatchMatchResult expected) const {
    return SameBits(engine_->DownloadState(estimate), {std::move(expected.planes), std::move(expected.cost)});
  }

  std::unique_ptr<PatchMatch> patch_match_;
  std::vector<PlanarView> rendered_;
  std::vector<EngineView> views_;
  std::vector<DepthMap> depths_;
  PatchMatchOptions options_;
};
INSTANTIATE_TEST_SUITE_P(Devices, EnginePassesTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(EnginePassesTest, GeometricPassReadsTheDepthsThatTheHostHalves) {
  PatchMatchProblem problem = MakeProblem(rendered_, 0, kRange);
  for (size_t i = 0; i < problem.sources.size(); ++i) problem.sources[i].depth = depths_[i + 1].View();
  const EngineEstimatePtr refined = engine_->RunGeometric(ProblemOf(0), options_, views_[0].estimate, 0);
  EXPECT_TRUE(IsSameAs(refined, patch_match_->RunGeometric(problem, options_, Start(), 0)));
  // Other depths give other bits: the comparison would notice.
  for (MatchView& source : problem.sources) source.depth = rendered_[0].depth.View();
  EXPECT_FALSE(IsSameAs(refined, patch_match_->RunGeometric(problem, options_, Start(), 0)));
}

TEST_P(EnginePassesTest, GeometricPassesOfThePapersReadTheFullDepths) {
  PatchMatchProblem problem = MakeProblem(rendered_, 0, kRange);
  for (size_t i = 0; i < problem.sources.size(); ++i) problem.sources[i].depth = depths_[i + 1].View();
  for (const Method method : {Method::kAcmh, Method::kAcmp}) {
    options_.method = method;
    const EngineEstimatePtr refined = engine_->RunGeometric(ProblemOf(0), options_, views_[0].estimate, 0);
    EXPECT_TRUE(IsSameAs(refined, patch_match_->RunGeometric(problem, options_, Start(), 0)));
  }
}

/// ACMM's steps at the coarsest scale and from there to the next one.
TEST_P(EnginePassesTest, EstimatesOfALevelGuideTheNextFinerOne) {
  options_.method = Method::kAcmh;
  options_.photometric_iterations = 3;
  std::vector<EngineEstimatePtr> full, coarse;
  for (size_t i = 0; i < views_.size(); ++i) {
    full.push_back(engine_->RunPhotometric(ProblemOf(i), options_, 0));
    coarse.push_back(engine_->RunPhotometric(ProblemOf(i), options_, 1));
  }
  const PinholeCamera halved = rendered_[0].camera.Halved();
  EngineProblem problem = ProblemOf(0);
  EXPECT_THROW(engine_->RunGeometric(problem, options_, coarse[0], 0), InvalidInputError) << "sources of another level";
  for (size_t i = 0; i < problem.sources.size(); ++i) problem.sources[i].estimate = coarse[i + 1];
  const EngineEstimatePtr refined = engine_->RunGeometric(problem, options_, coarse[0], 0);
  const EstimateState state = engine_->DownloadState(refined);
  ExpectValid(state, halved, kRange, 2.6f);
  EXPECT_FALSE(SameBits(state, engine_->DownloadState(coarse[0])));

  const EngineEstimatePtr guided = engine_->RestoreDetails(ProblemOf(0), options_, full[0], refined);
  const EstimateState own = engine_->DownloadState(full[0]), mixed = engine_->DownloadState(guided);
  ExpectValid(mixed, rendered_[0].camera, kRange, 2.0f);
  int kept = 0, within = 0, within_before = 0;
  const DepthMap before = engine_->Download(full[0]).depth, after = engine_->Download(guided).depth;
  for (size_t i = 0; i < before.size(); ++i) {
    kept += own.planes.data()[i].d == mixed.planes.data()[i].d ? 1 : 0;
    within_before += std::abs(before.data()[i] / rendered_[0].depth.data()[i] - 1) < 0.05 ? 1 : 0;
    within += std::abs(after.data()[i] / rendered_[0].depth.data()[i] - 1) < 0.05 ? 1 : 0;
  }
  EXPECT_GT(kept, 0);
  EXPECT_LT(kept, static_cast<int>(before.size()) / 2);
  EXPECT_GT(within, within_before * 9 / 10) << "on a plane the coarser scale is not much worse";
  EXPECT_THROW(engine_->RestoreDetails(ProblemOf(0), options_, full[0], full[0]), InvalidInputError);
}

TEST_P(EnginePassesTest, AStartThatNobodyElseHoldsGivesItsMemory) {
  const EngineProblem problem = ProblemOf(0);
  const auto copy = [&] {
    return engine_->UploadState(engine_->DownloadState(views_[0].estimate), rendered_[0].camera);
  };
  const auto same = [&](const EngineEstimatePtr& a, const EngineEstimatePtr& b) {
    return SameBits(engine_->DownloadState(a), engine_->DownloadState(b)) &&
           SamePixels(engine_->DownloadDepth(a), engine_->Download(b).depth);
  };
  const EngineEstimatePtr held = copy();
  const EngineEstimatePtr refined = engine_->RunGeometric(problem, options_, held, 0);
  EXPECT_TRUE(same(held, views_[0].estimate)) << "others may still read it";
  EXPECT_FALSE(same(refined, held));
  // On the GPU the new estimate is the old one; on the CPU its planes' memory is.
  const auto runs_in_place = [&](const auto& run, const EngineEstimatePtr& expected) {
    EngineEstimatePtr start = copy();
    const EngineEstimate* memory = start.get();
    const EngineEstimatePtr result = run(std::move(start));
    EXPECT_TRUE(same(result, expected));
    EXPECT_TRUE(GetParam() == Device::kCpu || result.get() == memory);
  };
  runs_in_place([&](EngineEstimatePtr start) { return engine_->RunGeometric(problem, options_, std::move(start), 0); },
                refined);
  const PriorMesh mesh =
      MakePriorMesh(rendered_[0].camera, engine_->FindSupportPoints(held, kRange, PlanarPriorOptions()), {});
  const EngineEstimatePtr assisted = engine_->RunPlanarPrior(problem, options_, held, mesh);
  EXPECT_TRUE(same(held, views_[0].estimate));
  runs_in_place(
      [&](EngineEstimatePtr start) { return engine_->RunPlanarPrior(problem, options_, std::move(start), mesh); },
      assisted);
}

TEST_P(EnginePassesTest, PlanarPriorPassReadsThePriorThatTheHostDraws) {
  const PriorMesh mesh = MakePriorMesh(
      rendered_[0].camera, engine_->FindSupportPoints(views_[0].estimate, kRange, PlanarPriorOptions()), {});
  ASSERT_GT(mesh.triangles.size(), 20u);
  const PlaneMap prior = RasterizePrior(rendered_[0].camera, mesh, kRange);
  const PatchMatchProblem problem = MakeProblem(rendered_, 0, kRange);
  const EngineEstimatePtr assisted = engine_->RunPlanarPrior(ProblemOf(0), options_, views_[0].estimate, mesh);
  EXPECT_TRUE(IsSameAs(assisted, patch_match_->RunPlanarPrior(problem, options_, Start(), prior.View())));
  const PlaneMap none(prior.width(), prior.height());
  EXPECT_FALSE(IsSameAs(assisted, patch_match_->RunPlanarPrior(problem, options_, Start(), none.View())));
}

}  // namespace
}  // namespace acmp
