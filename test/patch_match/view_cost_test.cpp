#include "acmp_mapping/patch_match/kernel/photometric_cost.h"

#include <array>
#include <cmath>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

using reference::CostKind;

float KernelCost(KernelState* state, const PlaneHypothesis& plane, int col, int row, int view) {
  const auto context = state->Context();
  ReferencePatch patch;
  LoadReferencePatch(context, col, row, context.options.sigma_color, SingleThread(), &patch);
  return PhotometricCost(context, patch, PlaneDual(context, plane), col, row, view);
}

reference::Cost ReferenceCost(const KernelState& state, const PlaneHypothesis& plane, int col, int row, int view) {
  return reference::PhotometricCost(state.problem(), state.options(), reference::ToDouble(plane), col, row, view);
}

/// How many costs of each CostKind were compared.
using Compared = std::array<int, 4>;

/// Compares one hypothesis with the reference, but where rounding decides between kinds of costs.
/// @param tolerance of what is matched; the other kinds have costs of their own
void ExpectSameCost(KernelState* state, const PlaneHypothesis& plane, int col, int row, int view, double tolerance,
                    Compared* compared) {
  const reference::Cost expected = ReferenceCost(*state, plane, col, row, view);
  const float cost = KernelCost(state, plane, col, row, view);
  ASSERT_TRUE(cost >= 0 && cost <= 2) << cost;
  // The kernel also gives up a window of which any sample would lie behind the source camera.
  if (expected.min_z <= 1e-3) {
    if (expected.min_z >= -1e-3) return;
    ASSERT_EQ(cost, kWorstCost);
    ++(*compared)[static_cast<size_t>(CostKind::kNoCorrespondence)];
    return;
  }
  // Within rounding of a variance floor either answer is right.
  const double floor = state->options().min_variance;
  if (std::abs(expected.reference_variance - floor) < 0.1 * floor) return;
  if (expected.kind != CostKind::kFlatReference && std::abs(expected.source_variance - floor) < 0.1 * floor) return;
  ASSERT_NEAR(cost, expected.value, expected.kind == CostKind::kMatched ? tolerance : 0)
      << "view " << view << " at " << col << ", " << row << ", variances " << expected.reference_variance << ", "
      << expected.source_variance;
  ++(*compared)[static_cast<size_t>(expected.kind)];
}

/// Of random pixels and planes, at most `max_tilt_deg` from their rays.
Compared CompareCosts(const std::vector<PlanarView>& views, int trials, double max_tilt_deg, double tolerance) {
  KernelState state(MakeProblem(views, 0, {1, 10}));
  TestRandom random(5);
  Compared compared = {};
  for (int i = 0; i < trials && !::testing::Test::HasFatalFailure(); ++i) {
    const int col = random.Below(state.width()), row = random.Below(state.height());
    const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 1.5, 10, max_tilt_deg, &random);
    ExpectSameCost(&state, plane, col, row, i % static_cast<int>(views.size() - 1), tolerance, &compared);
  }
  return compared;
}

TEST(PhotometricCostTest, EveryPixelOfSmallAndOddImages) {
  for (const auto& [width, height] : {std::pair(1, 1), {2, 2}, {3, 9}, {11, 11}, {7, 1}, {12, 5}, {17, 13}}) {
    std::vector<PlanarView> views = RandomViews(4, 21, 19, 6);
    views[0].camera = TestCamera(width, height);
    views[0].gray = RandomImage(width, height, 7);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    TestRandom random(8);
    Compared compared = {};
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        for (int i = 0; i < 12; ++i) {
          const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 3, 8, 50, &random);
          ASSERT_NO_FATAL_FAILURE(ExpectSameCost(&state, plane, col, row, i % 3, 1e-3, &compared))
              << width << " x " << height;
        }
      }
    }
    EXPECT_GT(compared[0] + compared[1] + compared[2] + compared[3], width * height) << width << " x " << height;
  }
}

TEST(PhotometricCostTest, AgreesWithTheReferenceUnderFaintTexture) {
  // Texture of about one grey level (wall paint, sensor noise) under an exposure difference of 30: the case where
  // float32 sums of plain grey values cancel to noise, 30^2 * 2^-22 = 2e-4 grey levels^2 on variances of about 0.15.
  std::vector<PlanarView> views = RandomViews(3, 49, 41, 10);
  views[0].gray = RandomImage(49, 41, 11, 199, 203);
  for (size_t i = 1; i < 3; ++i) {
    views[i].gray = RandomImage(views[i].camera.width, views[i].camera.height, 12 + i, 229, 233);
  }
  EXPECT_GT(CompareCosts(views, 5000, 60, 1e-2)[static_cast<size_t>(CostKind::kMatched)], 2000);
}

TEST(PhotometricCostTest, FlatWindowsHaveCostsOfTheirOwnWhateverTheExposure) {
  for (const float level : {0.0f, 0.1f, 77.7f, 254.9f}) {
    std::vector<PlanarView> views = RandomViews(3, 33, 27, 14);
    for (float& value : views[0].gray) value = level;
    for (float& value : views[1].gray) value = 255.0f - level;
    EXPECT_GT(CompareCosts(views, 3000, 75, 0)[static_cast<size_t>(CostKind::kFlatReference)], 1500) << level;
  }
  // Up to exposure differences of 100 grey levels the variance floor is above float32's rounding of the sums.
  for (const double difference : {-100.0, -30.0, 0.0, 0.3, 30.7, 60.0, 100.0}) {
    std::vector<PlanarView> views = RandomViews(2, 33, 27, 16);
    views[0].gray = RandomImage(33, 27, 17, 120, 135);
    for (float& value : views[1].gray) value = static_cast<float>(127.5 + 0.9 * difference);
    EXPECT_GT(CompareCosts(views, 5000, 75, 0)[static_cast<size_t>(CostKind::kFlatSource)], 2000) << difference;
  }
}

TEST(PhotometricCostTest, PointsBehindOrOutsideTheSourceAreWorst) {
  std::vector<PlanarView> views = RandomViews(5, 33, 27, 19);
  views[1].cam_from_world = LookAhead({0, 0, 0.1}, 180, 0, 0);  // looks back: everything is behind it
  views[2].cam_from_world = LookAhead({0, 0, 20}, 0, 0, 0);     // beyond the depths searched
  views[3].cam_from_world = LookAhead({0.1, 0, 0}, 90, 0, 0);   // looks aside
  views[4].cam_from_world = LookAhead({30, 0, 0}, 0, 0, 0);     // too far to the side to overlap
  EXPECT_GT(CompareCosts(views, 4000, 40, 0)[static_cast<size_t>(CostKind::kNoCorrespondence)], 3990);
}

// Where the geometric error is not what papers_test.cpp compares: the ends of what sources see.

TEST(GeometricErrorTest, IsTheTruncationWhereThereIsNothingToCompare) {
  std::vector<PlanarView> views = RandomViews(6, 33, 27, 3);
  views[1].cam_from_world = LookAhead({0, 0, 0.1}, 180, 0, 0);  // the point is behind the source
  views[2].cam_from_world = LookAhead({30, 0, 0}, 0, 0, 0);     // outside its image
  for (float& depth : views[3].depth) depth = 0;                // no depth there
  for (float& depth : views[5].depth) depth = -1;               // nonsense
  PatchMatchOptions options;
  options.geometric_max_px = 3.5f;
  PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  problem.sources[3].depth = {};  // no map at all
  KernelState state(problem, options);
  for (int view = 0; view < 5; ++view) EXPECT_EQ(GeometricError(state.Context(), 4, 16, 13, view), 3.5f) << view;
}

TEST(GeometricErrorTest, BackwardPointBehindTheReferenceIsTruncated) {
  // The source stands 5 m ahead on the optical axis, looking back at the reference; its depth claims a surface 8 m
  // away, which lies 3 m behind the reference camera. On the axis a point behind has the pixel of one in front.
  std::vector<PlanarView> views = RandomViews(2, 33, 27, 4);
  views[0].camera.cx = 16;
  views[0].camera.cy = 13;
  views[1].cam_from_world = LookAhead({0, 0, 5}, 180, 0, 0);
  for (float& depth : views[1].depth) depth = 8;
  PatchMatchOptions options;
  options.geometric_max_px = 5;
  KernelState behind(MakeProblem(views, 0, {1, 10}, true), options);
  EXPECT_EQ(GeometricError(behind.Context(), 3, 16, 13, 0), 5.0f);
  for (float& depth : views[1].depth) depth = 2;
  KernelState before(MakeProblem(views, 0, {1, 10}, true), options);
  EXPECT_LT(GeometricError(before.Context(), 3, 16, 13, 0), 0.01f);
}

}  // namespace
}  // namespace acmp
