#include "acmp_mapping/patch_match/kernel/converged.h"

#include <cmath>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr int kWidth = 60, kHeight = 44, kSources = 6;
constexpr float kCost = 0.25f;  // none that a comparison gives

/// A wall seen by seven cameras, whose true planes the first one has.
class ConvergedTest : public ::testing::Test {
 protected:
  /// Makes blocks of the sources' depths wrong.
  void SpoilDepths() {
    constexpr int kBlock = 4;
    TestRandom random(3);
    for (size_t i = 1; i < views_.size(); ++i) {
      DepthMap factors((kWidth + kBlock - 1) / kBlock, (kHeight + kBlock - 1) / kBlock);
      for (float& factor : factors) factor = static_cast<float>(random(0, 1) < 0.4 ? random(0.7, 1.4) : 1);
      for (int row = 0; row < kHeight; ++row) {
        for (int col = 0; col < kWidth; ++col) views_[i].depth(col, row) *= factors(col / kBlock, row / kBlock);
      }
    }
  }

  /// All pixels have the wall's plane, and a cost.
  KernelState State(int converged_views) {
    PatchMatchOptions options;
    options.converged_views = converged_views;
    KernelState state(MakeProblem(views_, 0, {1, 10}, true), options);
    const RigidTransform& camera = views_[0].cam_from_world;
    const Eigen::Vector3d normal = camera.linear() * wall_.normal;
    const double d = wall_.d - normal.dot(camera.translation());
    for (PlaneHypothesis& plane : state.planes) {
      plane = {static_cast<float>(normal.x()), static_cast<float>(normal.y()), static_cast<float>(normal.z()),
               static_cast<float>(d)};
    }
    for (float& cost : state.cost) cost = kCost;
    return state;
  }

  /// The definition. -1: rounding may decide.
  static int ReferenceAgreeing(const KernelState& state, int col, int row, uint32_t* mask) {
    const PlaneHypothesis plane = state.planes(col, row);
    const auto& problem = state.problem();
    const double depth =
        reference::Intersect(problem.reference.camera, Eigen::Vector2d(col, row), reference::ToDouble(plane)).z();
    *mask = 0;
    int agreeing = 0;
    for (int view = 0; view < kSources; ++view) {
      const double error = reference::ReprojectionError(problem, depth, col, row, view);
      if (std::abs(error - 1) < 1e-2) return -1;
      if (error >= 1) continue;
      *mask |= 1u << view;
      ++agreeing;
    }
    return agreeing;
  }

  WorldPlane wall_ = WorldPlane::Slanted(12, -8, 4);
  std::vector<PlanarView> views_ = RenderPlanarScene(wall_, kWidth, kHeight, kSources + 1);
};

TEST_F(ConvergedTest, AgreesWithTheDefinition) {
  SpoilDepths();
  for (const int needed : {1, 3, 4, 6}) {
    KernelState state = State(needed);
    int converged = 0, odd = 0, unclear = 0;
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        uint32_t mask;
        const int agreeing = ReferenceAgreeing(state, col, row, &mask);
        if (agreeing < 0) {
          ++unclear;
          continue;
        }
        const uint32_t expected = agreeing >= needed ? mask : 0;
        odd += ConvergedViews(state.Context(), col, row, SingleThread()) != expected ? 1 : 0;
        converged += expected != 0 ? 1 : 0;
      }
    }
    EXPECT_LE(odd, kWidth * kHeight / 100) << "but where a source pixel is read on the other side of a half";
    EXPECT_LT(unclear, kWidth * kHeight / 10);
    EXPECT_GT(converged, 100) << needed << " views";
    EXPECT_LT(converged, kWidth * kHeight - 100) << needed << " views";
  }
}

/// A pixel that converges with four views.
constexpr int kCol = 30, kRow = 20;

class ConvergedPixelTest : public ConvergedTest {
 protected:
  uint32_t Converged() { return ConvergedViews(state_.Context(), kCol, kRow, SingleThread()); }
  MatchContext<BilinearSampler> Context(int past_iterations) {
    MatchContext<BilinearSampler> context = state_.Context(2);
    context.past_geometric_iterations = past_iterations;
    return context;
  }

  KernelState state_ = State(4);
};

TEST_F(ConvergedPixelTest, CompletedPixelsAreNot) {
  EXPECT_NE(Converged(), 0u);
  for (const float cost : {kUnverifiedCost, kWorstCost}) {
    state_.cost(kCol, kRow) = cost;
    EXPECT_EQ(Converged(), 0u) << cost;
  }
}

TEST_F(ConvergedPixelTest, PixelsAtABreakAreNot) {
  state_.planes(kCol + 5, kRow).d *= 1.1f;
  EXPECT_EQ(Converged(), 0u);
}

TEST_F(ConvergedPixelTest, UpdatesLeaveThemFromTheThirdIterationOn) {
  const PlaneHypothesis plane = state_.planes(kCol, kRow);
  for (const auto& [past, iteration] : {std::pair(0, 0), {0, 1}, {1, 0}, {0, 2}, {1, 1}, {2, 0}, {4, 1}}) {
    state_.cost(kCol, kRow) = kCost;
    state_.planes(kCol, kRow) = plane;
    state_.selected_views(kCol, kRow) = 0;
    UpdatePixel<Pass::kGeometric>(Context(past), kCol, kRow, iteration);
    const bool left = past + iteration >= 2;
    EXPECT_EQ(state_.cost(kCol, kRow) == kCost, left) << past << " + " << iteration;
    if (!left) continue;
    EXPECT_TRUE(state_.planes(kCol, kRow).nx == plane.nx && state_.planes(kCol, kRow).d == plane.d);
    EXPECT_EQ(state_.selected_views(kCol, kRow), Converged()) << "neighbours read them";
  }
}

TEST_F(ConvergedPixelTest, GeometricPassesStartWithTheCostTheyHave) {
  for (const int past : {0, 2}) {
    state_.selected_views(kCol, kRow) = 0;
    InitializePixel<Pass::kGeometric>(Context(past), kCol, kRow);
    EXPECT_EQ(state_.cost(kCol, kRow), kCost);
    EXPECT_EQ(state_.selected_views(kCol, kRow), Converged());
  }
  InitializePixel<Pass::kPlanarPrior>(Context(2), kCol, kRow);
  EXPECT_NE(state_.cost(kCol, kRow), kCost);
}

TEST_F(ConvergedPixelTest, OtherPassesAndZeroViewsDoNotLeaveThem) {
  UpdatePixel<Pass::kPlanarPrior>(Context(4), kCol, kRow, 3);
  EXPECT_NE(state_.cost(kCol, kRow), kCost);
  KernelState never = State(0);
  MatchContext<BilinearSampler> context = never.Context(2);
  context.past_geometric_iterations = 4;
  UpdatePixel<Pass::kGeometric>(context, kCol, kRow, 3);
  EXPECT_NE(never.cost(kCol, kRow), kCost);
  never.cost(kCol, kRow) = kCost;
  InitializePixel<Pass::kGeometric>(context, kCol, kRow);
  EXPECT_NE(never.cost(kCol, kRow), kCost);
}

TEST_F(ConvergedPixelTest, PixelsUpdatedFirstKeepWhatTheyHave) {
  const PlaneHypothesis plane = state_.planes(kCol, kRow);
  state_.selected_views(kCol, kRow) = 5;
  InitializeUnmatched<Pass::kGeometric>(Context(2), kCol, kRow);
  EXPECT_EQ(state_.cost(kCol, kRow), kCost);
  EXPECT_EQ(state_.planes(kCol, kRow).d, plane.d);
  EXPECT_EQ(state_.selected_views(kCol, kRow), 0u);
}

}  // namespace
}  // namespace acmp
