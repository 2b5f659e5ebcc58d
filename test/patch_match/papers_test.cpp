// The presets of the papers and ours against plain references: every decision of every pixel of a small scene.

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/host_functions.h"
#include "acmp_mapping/patch_match/host_passes.h"
#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "acmp_mapping/pipeline/presets.h"
#include "acmp_mapping/planar_prior/planar_prior.h"
#include "support/kernel_state.h"
#include "support/paper_reference.h"
#include "support/pass_result.h"
#include "support/random_views.h"

namespace acmp {
namespace {

constexpr int kWidth = 32, kHeight = 24, kViews = 6;

GrayImage Halve(const GrayImage& image) {
  GrayImage halved(image.width() / 2, image.height() / 2);
  for (int row = 0; row < halved.height(); ++row) {
    for (int col = 0; col < halved.width(); ++col) {
      double sum = 0;
      for (int i = 0; i < 4; ++i) sum += image(2 * col + i % 2, 2 * row + i / 2);
      halved(col, row) = static_cast<float>(sum / 4);
    }
  }
  return halved;
}

/// A slanted wall with a blank strip and, in front of its right part, a board that some views see less of.
std::vector<PlanarView> RenderScene(int width, int height) {
  std::vector<PlanarView> views = RenderPlanarScene(WorldPlane::Slanted(20, -10, 4), width, height, kViews);
  const WorldPlane board = WorldPlane::Slanted(-10, 5, 2.6);
  const double pixel_m = board.d / views[0].camera.fx;
  const WaveTexture texture(7, 6 * pixel_m, 30 * pixel_m);
  TestRandom noise(5);
  for (PlanarView& view : views) {
    const PlanarView of_board = RenderPlane(board, texture, view.camera, view.cam_from_world);
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        const Eigen::Vector3d point =
            view.cam_from_world.inverse() * view.camera.Unproject({1.0 * col, 1.0 * row}, of_board.depth(col, row));
        if (point.x() > 0.3) {
          view.gray(col, row) = of_board.gray(col, row);
          view.depth(col, row) = of_board.depth(col, row);
        } else if (row >= 3 * height / 4) {
          view.gray(col, row) = static_cast<float>(130 + noise(-0.3, 0.3));
        }
      }
    }
  }
  return views;
}

/// How the kernels' outcomes compare with the reference's.
struct Comparison {
  int outcomes = 0;
  int changed_planes = 0;
  int near_ties = 0;  ///< other outcomes after a comparison that rounding decides
  std::vector<std::string> differences;

  void Add(const paper::Outcome& expected, const PlaneHypothesis& before, const KernelState& state, int col, int row) {
    ++outcomes;
    const PlaneHypothesis& plane = state.planes(col, row);
    const bool changed = plane.nx != before.nx || plane.ny != before.ny || plane.nz != before.nz || plane.d != before.d;
    changed_planes += changed ? 1 : 0;
    constexpr double kPlaneTolerance = 1e-5;  // float rounding of normals and distances: some 1e-6
    const double off_normal = (expected.plane.normal - reference::ToDouble(plane).normal).norm();
    const double off_d = std::abs(expected.plane.d - plane.d),
                 off_cost = std::abs(expected.cost - state.cost(col, row));
    if (off_normal < kPlaneTolerance && off_d < kPlaneTolerance * (1 + plane.d) && off_cost < expected.cost_tolerance &&
        state.selected_views(col, row) == expected.views) {
      return;
    }
    if (expected.is_near_tie) {
      ++near_ties;
      return;
    }
    differences.push_back(Concat("pixel ", col, ", ", row, ": normal off by ", off_normal, ", d by ", off_d, " of ",
                                 plane.d, ", cost ", state.cost(col, row), " for ", expected.cost, ", views ",
                                 state.selected_views(col, row), " for ", expected.views));
  }
};

class PapersTest : public ::testing::Test {
 protected:
  /// @param width,height of the rendered images, px
  /// @param level how often they are halved
  void Start(const std::string& preset, int width = kWidth, int height = kHeight, int level = 0) {
    options_ = MakePreset(preset);
    views_ = RenderScene(width, height);
    for (PlanarView& view : views_) {
      for (int i = 0; i < level; ++i) {
        view.camera = view.camera.Halved();
        view.gray = Halve(view.gray);
        view.depth = Halve(view.depth);
      }
    }
    problem_ = MakeProblem(views_, 0, range_, true);
    TestRandom random(3);
    for (PlanarView& view : views_) {  // estimates of the sources: noisy, some missing, some far off
      for (float& depth : view.depth) {
        const double kind = random(0, 1);
        depth = kind < 0.05 ? 0.0f : kind < 0.1 ? 0.5f : static_cast<float>(depth * random(0.99, 1.01));
      }
      view.depth(0, 0) = 1e-38f;  // no depth: of its inverse, as the greatest, the steps of all would be
    }
    state_ = std::make_unique<KernelState>(problem_, options_.patch_match);
    images_.clear();
    for (const MatchView& source : problem_.sources) images_.push_back(source.gray);
  }

  /// Calls function(col, row) for the pixels with (col + row) % 2 == color, row by row.
  template <class Function>
  void ForEachOfColor(int color, const Function& function) const {
    for (int row = 0; row < height(); ++row) {
      for (int col = (row + color) % 2; col < width(); col += 2) function(col, row);
    }
  }
  /// One pixel's step beside the reference's.
  template <class Step>
  void Compare(const paper::Outcome& expected, int col, int row, const Step& step, Comparison* comparison) {
    const PlaneHypothesis before = state_->planes(col, row);
    step(col, row);
    comparison->Add(expected, before, *state_, col, row);
  }
  MatchContext<CpuSampler> Context(uint32_t pass) {
    MatchContext<CpuSampler> context =
        state_->ContextWith(CpuSampler{{problem_.reference.gray, images_.data()}, SupportedHostFunctions().back()});
    context.pass_number = pass;
    return context;
  }
  paper::Maps Maps() const { return {state_->planes, state_->cost, state_->selected_views, state_->Prior()}; }

  /// Runs a pass pixel by pixel beside the reference, and checks that the CPU's pass, which takes rows in parallel and
  /// in whatever order, leaves the same bits.
  template <Pass kPass, Method kMethod>
  void RunPass(uint32_t pass, int iterations) {
    constexpr bool kIsOurs = kMethod == Method::kOurs;
    const EstimateState start = {state_->planes.Clone(), state_->cost.Clone()};
    const MatchContext<CpuSampler> context = Context(pass);
    paper::Reference reference(problem_, options_.patch_match, kPass, pass);
    const paper::Maps maps = Maps();
    Comparison comparison;
    for (int color = 0; color < 2; ++color) {
      ForEachOfColor(color, [&](int col, int row) {
        if constexpr (kIsOurs) {  // nobody reads these before their update
          if (color == 0) {
            const auto step = [&](int c, int r) { InitializeUnmatched<kPass>(context, c, r); };
            Compare(reference.InitializeUnmatched(maps, col, row), col, row, step, &comparison);
            return;
          }
        }
        const auto step = [&](int c, int r) { InitializePixel<kPass, kMethod>(context, c, r); };
        Compare(reference.Initialize(maps, col, row), col, row, step, &comparison);
      });
    }
    for (int iteration = 0; iteration < iterations; ++iteration) {
      for (int color = 0; color < 2; ++color) {
        ForEachOfColor(color, [&](int col, int row) {
          const auto step = [&](int c, int r) { UpdatePixel<kPass, kMethod>(context, c, r, iteration); };
          Compare(reference.Update(maps, col, row, iteration), col, row, step, &comparison);
        });
      }
    }
    for (int color = 0; kIsOurs && color < 2; ++color) {
      ForEachOfColor(color, [&](int col, int row) {
        const auto step = [&](int c, int r) { MedianFilterPixel(context, c, r); };
        Compare(reference.Filter(maps, col, row), col, row, step, &comparison);
      });
    }
    EXPECT_EQ(comparison.outcomes, width() * height() * (iterations + (kIsOurs ? 2 : 1)));
    Check(comparison);
    RecordProperty(Concat("near_ties_", pass), comparison.near_ties);
    ExpectSameAsCpu<kPass>(start, pass);
  }

  /// ACMM's step between two scales, in the same way.
  void RunRestorer(const PlaneMap& coarser) {
    const EstimateState start = {state_->planes.Clone(), state_->cost.Clone()};
    const MatchContext<CpuSampler> context = Context(0);
    const CoarserEstimate estimate = {coarser.View(), MakeRayGrid(problem_.reference.camera.Halved())};
    paper::Reference reference(problem_, options_.patch_match, Pass::kPhotometric, 0);
    Comparison comparison;
    for (int color = 0; color < 2; ++color) {
      ForEachOfColor(color, [&](int col, int row) {
        const auto step = [&](int c, int r) { RestorePixel(context, estimate, c, r); };
        Compare(reference.Restore(Maps(), coarser, col, row), col, row, step, &comparison);
      });
    }
    EXPECT_LT(comparison.changed_planes, comparison.outcomes) << "no details";
    Check(comparison);
    const EstimateState result = RestoreDetails(problem_, options_.patch_match, start.Clone(), coarser.View());
    EXPECT_TRUE(SamePixels(result.planes, state_->planes));
    EXPECT_TRUE(SamePixels(result.cost, state_->cost));
  }

  void Check(const Comparison& comparison) {
    EXPECT_GT(comparison.changed_planes, comparison.outcomes / 4) << "hardly anything to compare";
    EXPECT_TRUE(comparison.differences.empty())
        << comparison.differences.size() << " of " << comparison.outcomes << ", first: " << comparison.differences[0];
    // Rounding decides a handful of several thousand outcomes.
    EXPECT_LE(comparison.near_ties, comparison.outcomes / 500);
  }

  template <Pass kPass>
  void ExpectSameAsCpu(const EstimateState& start, uint32_t pass) {
    const PatchMatchOptions& options = options_.patch_match;
    const PriorMap prior = state_->Prior();
    const EstimateState result =
        acmp::RunPass(problem_, options, kPass, start.Clone(), prior, static_cast<int>(pass) - 2);
    EXPECT_TRUE(SamePixels(result.planes, state_->planes));
    EXPECT_TRUE(SamePixels(result.cost, state_->cost));
  }

  /// Steps 10 to 13 (planar_prior_test.cpp).
  void MakePrior() {
    const PinholeCamera& camera = problem_.reference.camera;
    const DepthMap depth = ToDepthMap(state_->planes, camera);
    const std::vector<SupportPoint> points =
        FindSupportPoints(depth.View(), state_->cost.View(), problem_.depth_range, options_.planar_prior);
    EXPECT_GT(points.size(), 10u);
    const PriorMesh mesh = MakePriorMesh(camera, points, options_.planar_prior);
    const Image<uint32_t>& numbers = state_->prior_numbers = RasterizePrior(camera, mesh, problem_.depth_range);
    state_->prior_planes = mesh.planes;
    EXPECT_LT(std::count(numbers.begin(), numbers.end(), 0u), static_cast<int>(numbers.size()) * 2 / 3);
  }

  int width() const { return problem_.reference.camera.width; }
  int height() const { return problem_.reference.camera.height; }

  PipelineOptions options_;
  DepthRange range_ = {1.5f, 8};
  std::vector<PlanarView> views_;
  std::vector<ImageView<const float>> images_;
  PatchMatchProblem problem_;
  std::unique_ptr<KernelState> state_;
};

TEST_F(PapersTest, AcmpIsAlgorithm1) {
  Start("acmp");
  RunPass<Pass::kPhotometric, Method::kAcmh>(0, 3);
  MakePrior();
  RunPass<Pass::kPlanarPrior, Method::kAcmp>(1, 3);
  for (uint32_t pass = 2; pass < 4; ++pass) {
    RunPass<Pass::kGeometric, Method::kAcmp>(pass, 2);
  }
}

TEST_F(PapersTest, AcmhIsThatOfItsPaper) {
  Start("acmh");
  RunPass<Pass::kPhotometric, Method::kAcmh>(0, 3);
  for (uint32_t pass = 2; pass < 4; ++pass) {
    RunPass<Pass::kGeometric, Method::kAcmh>(pass, 2);
  }
}

/// With planes near the ends of the depth range, which what starts near the prior must not leave.
TEST_F(PapersTest, OursIsItsReference) {
  range_ = {2.55f, 4.2f};
  for (const char* preset : {"balanced", "online"}) {
    SCOPED_TRACE(preset);
    Start(preset);
    const PatchMatchOptions& options = options_.patch_match;
    RunPass<Pass::kPhotometric, Method::kOurs>(0, options.photometric_iterations);
    MakePrior();
    RunPass<Pass::kPlanarPrior, Method::kOurs>(1, options.planar_prior_iterations);
    for (uint32_t pass = 2; pass < 4; ++pass) {
      RunPass<Pass::kGeometric, Method::kOurs>(pass, options.geometric_iterations);
    }
  }
}

/// Section 4: ACMH at the coarsest of three scales; each finer one starts from its own photometric estimate and what
/// the coarser one knows better. Geometric consistency twice at every scale.
TEST_F(PapersTest, AcmmIsThatOfItsPaper) {
  using Kind = KeyframeStep::Kind;
  constexpr int kCoarsest = 2, kFullWidth = 80, kFullHeight = 64;
  PlaneMap coarser;
  std::vector<KeyframeStep> steps;
  for (int level = kCoarsest; level >= 0; --level) {
    SCOPED_TRACE(Concat("level ", level));
    Start("acmm", kFullWidth, kFullHeight, level);
    RunPass<Pass::kPhotometric, Method::kAcmh>(0, 3);
    if (level < kCoarsest) RunRestorer(coarser);
    steps.push_back({level < kCoarsest ? Kind::kNextScale : Kind::kInitial, 0, level});
    for (int pass = 0; pass < 2; ++pass) {
      RunPass<Pass::kGeometric, Method::kAcmh>(static_cast<uint32_t>(pass + 2), 2);
      steps.push_back({Kind::kGeometricPass, pass, level});
    }
    coarser = state_->planes.Clone();
  }
  const std::vector<KeyframeStep> schedule = ScheduleOf(options_);
  ASSERT_EQ(schedule.size(), steps.size());
  for (size_t i = 0; i < steps.size(); ++i) {
    EXPECT_EQ(schedule[i].kind, steps[i].kind) << i;
    EXPECT_EQ(schedule[i].pass, steps[i].pass) << i;
    EXPECT_EQ(schedule[i].level, steps[i].level) << i;
  }
}

}  // namespace
}  // namespace acmp
