#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/host_passes.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "support/devices.h"
#include "support/engine_scene.h"
#include "support/pass_result.h"
#include "support/random_views.h"

// CPU and GPU run the same source, but not the same arithmetic: the GPU contracts to fused multiply-adds, has its own
// exp, sin and cos and interpolates in textures with 8-bit fractions. Per cost that is small, but PatchMatch decides by
// comparison: one decision the other way changes what neighbours see. So parity is a rate, tight where texture makes
// the optimum unique, and both devices' accuracy is compared with the truth. What passes must hold on each device alone
// is in passes_test.cpp.

namespace acmp {
namespace {

const WorldPlane kPlane = WorldPlane::Slanted(25, -15, 4);

// Limits, all for texture that makes the optimum unique. Two seeds on the CPU, that is, two runs without a single
// random number in common, differ by more than 1 % of depth at 0.4 % of the pixels after the photometric pass and at
// none after the others, by 0.25 points in the share of pixels near the truth and by 3e-4 in the mean cost. Devices
// share the random numbers, so they must not differ by more than about twice that.
constexpr double kMaxDiffering = 0.01;            ///< share of pixels whose depths differ by more than 1 %
constexpr double kMaxAccuracyDifference = 0.006;  ///< of the shares of pixels near the truth
/// Of the mean cost: twice the seeds' difference, and texture fractions of 1/256 px, which shift samples by up to
/// 1/512 px.
constexpr double kMaxCostDifference = 1e-3;

/// One problem on one device.
struct OnDevice {
  OnDevice(Device device, const std::vector<PlanarView>& views, const DepthRange& range)
      : engine(MakeDepthEngine(device).engine), problem(MakeEngineProblem(views, range, true, engine.get())) {}

  /// @param start of any device; its depths are those of its planes
  EstimateState Run(Pass pass, const PatchMatchOptions& options, const EstimateState& start, const PriorMesh& prior,
                    int geometric_pass = 0) const {
    if (pass == Pass::kPhotometric) return engine->DownloadState(engine->RunPhotometric(problem, options, 0));
    const EngineEstimatePtr from = engine->UploadState(start.Clone(), problem.reference.frame->camera);
    return engine->DownloadState(pass == Pass::kPlanarPrior
                                     ? engine->RunPlanarPrior(problem, options, from, prior)
                                     : engine->RunGeometric(problem, options, from, geometric_pass));
  }
  EstimateState RunPhotometric(const PatchMatchOptions& options = {}) const {
    return Run(Pass::kPhotometric, options, {}, {});
  }

  std::unique_ptr<DepthEngine> engine;
  EngineProblem problem;
};

/// The same problem on both devices, or a skip with the reason.
class CudaParityTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::unique_ptr<DepthEngine> cuda;
    MakeEngineOrSkip(Device::kCuda, &cuda);
    if (!IsSkipped()) SetScene(RenderPlanarScene(kPlane, 96, 72, 6), {2, 8});
  }

  void SetScene(std::vector<PlanarView> views, const DepthRange& range) {
    views_ = std::move(views);
    cpu_ = std::make_unique<OnDevice>(Device::kCpu, views_, range);
    cuda_ = std::make_unique<OnDevice>(Device::kCuda, views_, range);
    prior_ = PriorOfPlane(views_[0].camera, ToHypothesis(kPlane));
  }

  DepthMap DepthOf(const EstimateState& state) const { return ToDepthMap(state.planes, views_[0].camera); }
  double NearTruth(const EstimateState& state, double tolerance) const {
    return ShareWithin(DepthOf(state), views_[0].depth, tolerance);
  }
  /// Share of the pixels where depths differ by more than 1 %.
  double Differing(const EstimateState& a, const EstimateState& b) const {
    return 1 - ShareWithin(DepthOf(a), DepthOf(b), 0.01);
  }
  static double MeanCost(const EstimateState& state) {
    return std::accumulate(state.cost.begin(), state.cost.end(), 0.0) / static_cast<double>(state.cost.size());
  }

  void ExpectParity(const EstimateState& cpu, const EstimateState& cuda) const {
    EXPECT_LE(Differing(cpu, cuda), kMaxDiffering);
    for (const double tolerance : {0.005, 0.01, 0.02}) {
      EXPECT_NEAR(NearTruth(cpu, tolerance), NearTruth(cuda, tolerance), kMaxAccuracyDifference) << tolerance;
    }
    EXPECT_NEAR(MeanCost(cpu), MeanCost(cuda), kMaxCostDifference);
  }

  std::vector<PlanarView> views_;
  std::unique_ptr<OnDevice> cpu_, cuda_;
  PriorMesh prior_;
};

TEST_F(CudaParityTest, EachPassFromTheSameStart) {
  const EstimateState start = cpu_->RunPhotometric();
  ExpectParity(start, cuda_->RunPhotometric());
  for (const Pass pass : {Pass::kPlanarPrior, Pass::kGeometric}) {
    ExpectParity(cpu_->Run(pass, {}, start, prior_), cuda_->Run(pass, {}, start, prior_));
  }
}

TEST_F(CudaParityTest, AllPassesInARow) {
  const auto run = [](const OnDevice& device) {
    EstimateState state = device.Run(Pass::kPlanarPrior, {}, device.RunPhotometric(), {});
    state = device.Run(Pass::kGeometric, {}, state, {}, 0);
    return device.Run(Pass::kGeometric, {}, state, {}, 1);
  };
  ExpectParity(run(*cpu_), run(*cuda_));
}

/// The papers' passes have no median filter and leave more pixels to chance: devices, which share the random numbers,
/// may differ as two seeds on the CPU do.
TEST_F(CudaParityTest, PassesOfThePapersDifferNoMoreThanTwoSeeds) {
  const EstimateState start = cpu_->RunPhotometric();
  for (const auto& [pass, method] : {std::pair(Pass::kPhotometric, Method::kAcmh),
                                     {Pass::kPlanarPrior, Method::kAcmp},
                                     {Pass::kGeometric, Method::kAcmh},
                                     {Pass::kGeometric, Method::kAcmp}}) {
    PatchMatchOptions options, other;
    options.method = other.method = method;
    other.seed = 2;
    const EstimateState on_cpu = cpu_->Run(pass, options, start, prior_);
    const EstimateState on_cuda = cuda_->Run(pass, options, start, prior_);
    EXPECT_LE(Differing(on_cpu, on_cuda), Differing(on_cpu, cpu_->Run(pass, other, start, prior_)) + kMaxDiffering);
    EXPECT_NEAR(NearTruth(on_cpu, 0.01), NearTruth(on_cuda, 0.01), 0.01);
    // Without the sources' depths a geometric pass's costs are higher by 0.5.
    EXPECT_NEAR(MeanCost(on_cpu), MeanCost(on_cuda), 0.05);
  }
}

TEST_F(CudaParityTest, PriorOnBlankWallsIsTheSameToItsWidth) {
  // Without texture the prior's draws decide. They are the same on both devices but for rounding. Triangles of all
  // sizes, some of which leave the range, each with a plane of its own.
  std::vector<PlanarView> views = RenderPlanarScene(kPlane, 60, 45, 5);
  for (PlanarView& view : views) std::fill(view.gray.begin(), view.gray.end(), 120.0f);
  SetScene(std::move(views), {2, 8});
  TestRandom random(4);
  std::vector<SupportPoint> points;
  for (int row = 0; row < 45; row += 1 + random.Below(9)) {
    for (int col = random.Below(5); col < 60; col += 1 + random.Below(15)) {
      points.push_back({col, row, static_cast<float>(random(2, 8))});
    }
  }
  const EstimateState start = cpu_->RunPhotometric();
  for (const PriorMesh& prior : {prior_, MakePriorMesh(views_[0].camera, points, {})}) {
    // As two seeds on the CPU do: 0.
    EXPECT_LE(
        Differing(cpu_->Run(Pass::kPlanarPrior, {}, start, prior), cuda_->Run(Pass::kPlanarPrior, {}, start, prior)),
        0.01);
  }
}

TEST_F(CudaParityTest, PriorOfTheGridIsTheSame) {
  // As above, with holes over which coarser levels go on.
  std::vector<PlanarView> views = RenderPlanarScene(kPlane, 60, 45, 5);
  for (PlanarView& view : views) std::fill(view.gray.begin(), view.gray.end(), 120.0f);
  SetScene(std::move(views), {2, 8});
  TestRandom random(5);
  EstimateState start = cpu_->RunPhotometric();
  for (int row = 0; row < 45; ++row) {
    for (int col = 0; col < 60; ++col) {
      const bool in_hole = col > 20 && col < 45 && row > 10 && row < 30;
      start.cost(col, row) = !in_hole && random(0, 1) < 0.05 ? static_cast<float>(random(0, 0.09)) : 1.0f;
    }
  }
  const auto run = [&](const OnDevice& device) {
    const EngineEstimatePtr from = device.engine->UploadState(start.Clone(), views_[0].camera);
    return device.engine->DownloadState(device.engine->RunGridPrior(device.problem, {}, from, {}));
  };
  EXPECT_LE(Differing(run(*cpu_), run(*cuda_)), 0.01);
  EXPECT_GT(Differing(run(*cpu_), cpu_->Run(Pass::kPlanarPrior, {}, start, {})), 0.1) << "without a prior";
}

TEST_F(CudaParityTest, InitialisationDrawsTheSamePlanes) {
  // Whatever cannot be matched keeps its first random plane: the streams and their use agree to rounding.
  std::vector<PlanarView> views = RandomViews(4, 61, 45, 7);
  for (size_t i = 1; i < 4; ++i) {
    views[i].cam_from_world = LookAhead({0.1, 0.0, 0.1 * static_cast<double>(i)}, 180, 0, 0);
  }
  SetScene(std::move(views), {1, 10});
  PatchMatchOptions options;
  options.method = Method::kAcmh;  // no median filter
  const EstimateState on_cpu = cpu_->RunPhotometric(options), on_cuda = cuda_->RunPhotometric(options);
  // Costs are 2 everywhere, so no hypothesis ever replaces the first.
  size_t differing = 0;
  for (size_t i = 0; i < on_cpu.planes.size(); ++i) {
    const PlaneHypothesis& a = on_cpu.planes.data()[i];
    const PlaneHypothesis& b = on_cuda.planes.data()[i];
    // sin, cos and fused products differ in the last few bits: 1e-6 of unit normals and of distances below 16.
    const double off =
        std::max({std::abs(a.nx - b.nx), std::abs(a.ny - b.ny), std::abs(a.nz - b.nz), std::abs(a.d - b.d) / 16});
    differing += off > 2e-6;
  }
  EXPECT_LE(differing, on_cpu.planes.size() / 100);
}

TEST_F(CudaParityTest, RandomImagesGiveTheSameStatistics) {
  // Nothing matches: every pixel is chaotic, but the distribution of costs is the device's no less than the CPU's.
  SetScene(RandomViews(6, 81, 63, 8), {1, 10});
  const auto quantiles = [](const EstimateState& result) {
    std::vector<float> costs(result.cost.begin(), result.cost.end());
    std::sort(costs.begin(), costs.end());
    return std::array<float, 3>{costs[costs.size() / 10], costs[costs.size() / 2], costs[costs.size() * 9 / 10]};
  };
  const auto on_cpu = quantiles(cpu_->RunPhotometric()), on_cuda = quantiles(cuda_->RunPhotometric());
  // Two seeds on the CPU differ by up to 0.005.
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(on_cpu[i], on_cuda[i], 0.015) << i;
}

}  // namespace
}  // namespace acmp
