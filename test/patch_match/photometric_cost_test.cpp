#include "acmp_mapping/patch_match/kernel/photometric_cost.h"

#include <cmath>
#include <set>

#include "gtest/gtest.h"

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

TEST(ReferencePatchTest, HasTheWindowsSamplesAndMoments) {
  const std::vector<PlanarView> views = RandomViews(2, 31, 23, 1);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  for (const auto& [col, row] : {std::pair(15, 11), {0, 0}, {30, 22}, {3, 20}, {30, 5}}) {
    ReferencePatch patch;
    LoadReferencePatch(state.Context(), col, row, state.options().sigma_color, SingleThread(), &patch);
    const double center = views[0].gray(col, row);
    double weights = 0, sum = 0, squares = 0;
    std::set<std::pair<int, int>> offsets;
    for (int i = 0; i < kPatchSamples; ++i) {
      const int dx = WindowCol(i), dy = WindowRow(i);
      offsets.insert({dx, dy});
      if (!views[0].gray.View().Contains(col + dx, row + dy)) {
        EXPECT_EQ(patch.samples[i].weight, 0) << "outside the image";
        continue;
      }
      const double value = views[0].gray(col + dx, row + dy) - center;
      const double weight = reference::BilateralWeight(std::hypot(dx, dy), value, state.options());
      EXPECT_NEAR(patch.samples[i].value, value, 1e-5);
      EXPECT_NEAR(patch.samples[i].weight, weight, 1e-6);
      weights += weight;
      sum += weight * value;
      squares += weight * value * value;
    }
    // Every second pixel from -5 to 5, each once.
    std::set<std::pair<int, int>> expected;
    for (int dy = -5; dy <= 5; dy += 2) {
      for (int dx = -5; dx <= 5; dx += 2) expected.insert({dx, dy});
    }
    EXPECT_EQ(offsets, expected);
    EXPECT_NEAR(patch.inv_sum_weight * weights, 1, 1e-5);
    EXPECT_NEAR(patch.mean, sum / weights, 1e-3);  // relative 1e-6 of values up to 255
    EXPECT_NEAR(patch.variance / (squares / weights - sum * sum / (weights * weights)), 1, 1e-3);
  }
}

/// Warp against intersection and projection in double: centre and both steps, for all sources.
TEST(PlaneWarpTest, ProjectsAsTheCamerasDo) {
  const std::vector<PlanarView> views = RandomViews(6, 161, 119, 2);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  const auto context = state.Context();
  TestRandom random(3);
  for (int i = 0; i < 2000; ++i) {
    const int col = random.Below(161), row = random.Below(119), view = i % 5;
    const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 2, 10, 60, &random);
    const PlaneWarp warp = MakePlaneWarp(context.sources[view], PlaneDual(context, plane), static_cast<float>(col),
                                         static_cast<float>(row));
    for (const auto& [dx, dy] : {std::pair(0, 0), {5, -3}, {-5, 5}}) {
      const Eigen::Vector2d pixel(col + dx, row + dy);
      double z;
      const Eigen::Vector2d expected = reference::Transfer(state.problem().reference, state.problem().sources[view],
                                                           reference::ToDouble(plane), pixel, &z);
      const Vec3f at = warp.center + static_cast<float>(dx) * warp.step_col + static_cast<float>(dy) * warp.step_row;
      const double reference_depth = reference::Intersect(views[0].camera, pixel, reference::ToDouble(plane)).z();
      // Homogeneous depth is that of the source over that of the reference. Coordinates of about 200 px have a float
      // spacing of 1.5e-5 px; the dozen operations of the warp add up to a few of them.
      EXPECT_NEAR(at.z, z / reference_depth, 1e-5);
      EXPECT_NEAR(at.x / at.z, expected.x(), 5e-4);
      EXPECT_NEAR(at.y / at.z, expected.y(), 5e-4);
    }
  }
}

/// Compares one hypothesis with the reference; returns what kind of cost it was, or nothing where rounding decides
/// between kinds.
void ExpectSameCost(KernelState* state, const PlaneHypothesis& plane, int col, int row, int view, double tolerance,
                    int (&compared)[4]) {
  const reference::Cost expected = ReferenceCost(*state, plane, col, row, view);
  const float cost = KernelCost(state, plane, col, row, view);
  ASSERT_GE(cost, 0);
  ASSERT_LE(cost, 2);
  // The kernel also gives up a window of which any sample would lie behind the source camera.
  if (expected.min_z <= 1e-3) {
    if (expected.min_z < -1e-3) {
      ASSERT_EQ(cost, kWorstCost);
    }
    return;
  }
  // Within rounding of a variance floor either answer is right.
  const double floor = state->options().min_variance;
  if (std::abs(expected.reference_variance - floor) < 0.1 * floor) return;
  if (expected.kind != CostKind::kFlatReference && std::abs(expected.source_variance - floor) < 0.1 * floor) return;
  ASSERT_NEAR(cost, expected.value, tolerance) << "view " << view << " at " << col << ", " << row << ", variances "
                                               << expected.reference_variance << ", " << expected.source_variance;
  ++compared[static_cast<int>(expected.kind)];
}

TEST(PhotometricCostTest, AgreesWithTheReferenceOnRandomImages) {
  const std::vector<PlanarView> views = RandomViews(5, 65, 49, 4);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  TestRandom random(5);
  int compared[4] = {};
  for (int i = 0; i < 20000; ++i) {
    const int col = random.Below(65), row = random.Below(49);
    const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 1.5, 10, 80, &random);
    // A sample's position is off by up to 1e-4 px where the window is seen at a grazing angle; at gradients of up to
    // 100 grey levels per px that is 1e-2 of a standard deviation of about 20.
    ASSERT_NO_FATAL_FAILURE(ExpectSameCost(&state, plane, col, row, i % 4, 5e-4, compared)) << i;
  }
  EXPECT_GT(compared[static_cast<int>(CostKind::kMatched)], 10000);
  EXPECT_GT(compared[static_cast<int>(CostKind::kNoCorrespondence)], 500);
}

TEST(PhotometricCostTest, EveryPixelOfSmallAndOddImages) {
  for (const auto& [width, height] : {std::pair(1, 1), {2, 2}, {3, 9}, {11, 11}, {7, 1}, {12, 5}, {17, 13}}) {
    std::vector<PlanarView> views = RandomViews(4, 21, 19, 6);
    views[0].camera = TestCamera(width, height);
    views[0].gray = RandomImage(width, height, 7);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    TestRandom random(8);
    int compared[4] = {};
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        for (int i = 0; i < 12; ++i) {
          const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 3, 8, 50, &random);
          ASSERT_NO_FATAL_FAILURE(ExpectSameCost(&state, plane, col, row, i % 3, 1e-3, compared))
              << width << " x " << height;
        }
      }
    }
    EXPECT_GT(compared[0] + compared[1] + compared[2] + compared[3], width * height) << width << " x " << height;
  }
}

TEST(PhotometricCostTest, WindowsCutByTheBorderUseWhatIsLeft) {
  // The true plane of a consistent scene matches at the very corners as well: absent samples must not count.
  const std::vector<PlanarView> views = RenderPlanarScene(WorldPlane::Slanted(20, 10, 4), 80, 60, 3);
  KernelState state(MakeProblem(views, 0, {2, 8}));
  const Eigen::Vector3d normal = WorldPlane::Slanted(20, 10, 4).normal;
  const PlaneHypothesis truth = {static_cast<float>(normal.x()), static_cast<float>(normal.y()),
                                 static_cast<float>(normal.z()), static_cast<float>(WorldPlane::Slanted(20, 10, 4).d)};
  int matched = 0;
  for (const auto& [col, row] : {std::pair(0, 0), {79, 0}, {0, 59}, {79, 59}, {0, 30}, {79, 30}, {40, 0}, {40, 59}}) {
    for (int view = 0; view < 2; ++view) {
      const reference::Cost expected = ReferenceCost(state, truth, col, row, view);
      if (expected.kind != CostKind::kMatched) continue;
      EXPECT_NEAR(KernelCost(&state, truth, col, row, view), expected.value, 5e-4);
      ++matched;
    }
  }
  EXPECT_GE(matched, 6);
}

TEST(PhotometricCostTest, TrueHypothesesAreNearlyPerfectAndWrongOnesAreNot) {
  const WorldPlane plane = WorldPlane::Slanted(25, -15, 4);
  const std::vector<PlanarView> views = RenderPlanarScene(plane, 120, 90, 4);
  KernelState state(MakeProblem(views, 0, {2, 8}));
  const Vec3f normal = {static_cast<float>(plane.normal.x()), static_cast<float>(plane.normal.y()),
                        static_cast<float>(plane.normal.z())};
  const auto with_distance = [&](double d) {
    return PlaneHypothesis{normal.x, normal.y, normal.z, static_cast<float>(d)};
  };
  double sum_true = 0, sum_wrong = 0;
  int count = 0;
  for (int row = 10; row < 80; row += 7) {
    for (int col = 15; col < 105; col += 7) {
      for (int view = 0; view < 3; ++view) {
        sum_true += KernelCost(&state, with_distance(plane.d), col, row, view);
        sum_wrong += KernelCost(&state, with_distance(1.15 * plane.d), col, row, view);
        ++count;
      }
    }
  }
  EXPECT_LT(sum_true / count, 0.01);   // bilinear sampling of waves of 6 px and more
  EXPECT_GT(sum_wrong / count, 0.25);  // 15 % of depth: about 1.1 px of disparity
}

TEST(PhotometricCostTest, DoesNotDependOnTheSourcesExposure) {
  // NCC is invariant to gain and offset; float32 must keep it so up to the offsets of real cameras.
  const WorldPlane plane = WorldPlane::Slanted(25, -15, 4);
  const std::vector<PlanarView> views = RenderPlanarScene(plane, 80, 60, 2);
  KernelState base(MakeProblem(views, 0, {2, 8}));
  for (const auto& [gain, offset] :
       {std::pair(1.0f, 60.0f), {1.0f, -60.0f}, {0.5f, 0.0f}, {0.7f, 70.0f}, {0.2f, 10.0f}}) {
    PlanarView changed;
    changed.camera = views[1].camera;
    changed.cam_from_world = views[1].cam_from_world;
    changed.gray = views[1].gray.Clone();
    for (float& value : changed.gray) value = gain * value + offset;
    PatchMatchProblem problem = MakeProblem(views, 0, {2, 8});
    problem.sources[0] = changed.View();
    KernelState state(problem);
    TestRandom random(9);
    for (int i = 0; i < 2000; ++i) {
      const int col = random.Below(80), row = random.Below(60);
      const PlaneHypothesis hypothesis = RandomHypothesis(views[0].camera, col, row, 3, 6, 50, &random);
      // Sums relative to the reference's centre grow with the squared offset: 60^2 * 1e-6 on variances of hundreds.
      ASSERT_NEAR(KernelCost(&state, hypothesis, col, row, 0), KernelCost(&base, hypothesis, col, row, 0), 2e-3)
          << gain << ", " << offset;
    }
  }
}

TEST(PhotometricCostTest, AgreesWithTheReferenceUnderFaintTexture) {
  // Texture of about one grey level (wall paint, sensor noise) under an exposure difference of 30: the case where
  // float32 sums of plain grey values cancel to noise.
  std::vector<PlanarView> views = RandomViews(3, 49, 41, 10);
  views[0].gray = RandomImage(49, 41, 11, 199, 203);
  for (size_t i = 1; i < 3; ++i) {
    views[i].gray = RandomImage(views[i].camera.width, views[i].camera.height, 12 + i, 229, 233);
  }
  KernelState state(MakeProblem(views, 0, {1, 10}));
  TestRandom random(13);
  int compared[4] = {};
  for (int i = 0; i < 5000; ++i) {
    const int col = random.Below(49), row = random.Below(41);
    const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
    // 30^2 * 2^-22 = 2e-4 grey levels^2 of rounding on variances of about 0.15.
    ASSERT_NO_FATAL_FAILURE(ExpectSameCost(&state, plane, col, row, i % 2, 1e-2, compared)) << i;
  }
  EXPECT_GT(compared[static_cast<int>(CostKind::kMatched)], 2000);
}

TEST(PhotometricCostTest, FlatReferenceWindowsAreUninformed) {
  // Whatever the exposure of either image, in whole or fractional grey levels, and whatever the source shows.
  for (const float level : {0.0f, 0.1f, 77.7f, 254.9f}) {
    std::vector<PlanarView> views = RandomViews(3, 33, 27, 14);
    for (float& value : views[0].gray) value = level;
    for (float& value : views[1].gray) value = 255.0f - level;
    KernelState state(MakeProblem(views, 0, {1, 10}));
    TestRandom random(15);
    for (int i = 0; i < 3000; ++i) {
      const int col = random.Below(33), row = random.Below(27), view = i % 2;
      const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 1.5, 10, 75, &random);
      const reference::Cost expected = ReferenceCost(state, plane, col, row, view);
      const float cost = KernelCost(&state, plane, col, row, view);
      if (expected.kind == CostKind::kFlatReference && expected.min_z > 1e-3) {
        ASSERT_EQ(cost, kUninformedCost) << "level " << level;
      } else {
        ASSERT_TRUE(cost == kWorstCost || cost == kUninformedCost);
      }
    }
  }
}

TEST(PhotometricCostTest, FlatSourceWindowsUnderTextureAreWorst) {
  // Up to exposure differences of 100 grey levels the variance floor is above float32's rounding of the sums.
  for (const double difference : {-100.0, -30.0, 0.0, 0.3, 30.7, 60.0, 100.0}) {
    std::vector<PlanarView> views = RandomViews(2, 33, 27, 16);
    views[0].gray = RandomImage(33, 27, 17, 120, 135);
    for (float& value : views[1].gray) value = static_cast<float>(127.5 + 0.9 * difference);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    TestRandom random(18);
    int flat = 0;
    for (int i = 0; i < 5000; ++i) {
      const int col = random.Below(33), row = random.Below(27);
      const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 1.5, 10, 75, &random);
      const reference::Cost expected = ReferenceCost(state, plane, col, row, 0);
      if (expected.kind != CostKind::kFlatSource) continue;
      ASSERT_EQ(KernelCost(&state, plane, col, row, 0), kWorstCost) << "difference " << difference;
      ++flat;
    }
    EXPECT_GT(flat, 2000);
  }
}

TEST(PhotometricCostTest, FlatSourceWindowsNeverMatchAtAnyExposure) {
  // A white wall under a dark textured window: beyond 100 grey levels rounding may pass for a texture, but one that
  // correlates with nothing, so the cost is that of no information instead of the worst.
  for (const float level : {160.1f, 200.2f, 254.9f}) {
    std::vector<PlanarView> views = RandomViews(2, 33, 27, 16);
    for (const double contrast : {2.0, 40.0}) {
      views[0].gray = RandomImage(33, 27, 17, 10, 10 + contrast);
      for (float& value : views[1].gray) value = level;
      KernelState state(MakeProblem(views, 0, {1, 10}));
      TestRandom random(18);
      for (int i = 0; i < 5000; ++i) {
        const int col = random.Below(33), row = random.Below(27);
        const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 1.5, 10, 75, &random);
        // Largest deviation from 1 seen over 600,000 windows: 0.003.
        ASSERT_GT(KernelCost(&state, plane, col, row, 0), 0.98) << "level " << level;
      }
    }
  }
}

TEST(PhotometricCostTest, PointsBehindOrOutsideTheSourceAreWorst) {
  std::vector<PlanarView> views = RandomViews(5, 33, 27, 19);
  views[1].cam_from_world = LookAhead({0, 0, 0.1}, 180, 0, 0);  // looks back: everything is behind it
  views[2].cam_from_world = LookAhead({0, 0, 20}, 0, 0, 0);     // beyond the depths searched
  views[3].cam_from_world = LookAhead({0.1, 0, 0}, 90, 0, 0);   // looks aside
  views[4].cam_from_world = LookAhead({30, 0, 0}, 0, 0, 0);     // too far to the side to overlap
  KernelState state(MakeProblem(views, 0, {1, 10}));
  TestRandom random(20);
  for (int i = 0; i < 4000; ++i) {
    const int col = random.Below(33), row = random.Below(27), view = i % 4;
    const PlaneHypothesis plane = RandomHypothesis(views[0].camera, col, row, 1, 10, 40, &random);
    ASSERT_EQ(KernelCost(&state, plane, col, row, view), kWorstCost) << "view " << view;
  }
}

TEST(PhotometricCostTest, CentreDecidesAtTheSourcesBorder) {
  // A source shifted so that a fronto-parallel plane moves by whole pixels: centres are inside from -0.5 on.
  std::vector<PlanarView> views = RandomViews(2, 41, 31, 21);
  for (PlanarView& view : views) view.camera = {41, 31, 40, 40, 20, 15};
  views[1].gray = RandomImage(41, 31, 22);
  const double depth = 4, shift_px = 3;
  views[1].cam_from_world = LookAhead({shift_px * depth / 40, 0, 0}, 0, 0, 0);  // pixels move left by 3
  KernelState state(MakeProblem(views, 0, {1, 10}));
  const PlaneHypothesis inside = {0, 0, -1, static_cast<float>(depth)};
  EXPECT_EQ(KernelCost(&state, inside, 2, 15, 0), kWorstCost);  // lands at -1
  EXPECT_LT(KernelCost(&state, inside, 3, 15, 0), kWorstCost);  // lands at 0
  // Disparity 3.4 px and 3.6 px for column 3: at -0.4 and -0.6.
  const auto at_disparity = [](double px) { return PlaneHypothesis{0, 0, -1, static_cast<float>(12.0 / px)}; };
  EXPECT_LT(KernelCost(&state, at_disparity(3.4), 3, 15, 0), kWorstCost);
  EXPECT_EQ(KernelCost(&state, at_disparity(3.6), 3, 15, 0), kWorstCost);
}

TEST(PhotometricCostTest, DegeneratePlanesGiveACost) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 23);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  for (const PlaneHypothesis& plane :
       {PlaneHypothesis{}, {0, 0, -1, 0}, {1, 0, 0, 1e-30f}, {0, 0, -1, 1e30f}, {0, 0, -1, 1e-42f}, {0, 0, 1, 3}}) {
    const float cost = KernelCost(&state, plane, 16, 13, 0);
    EXPECT_TRUE(cost >= 0 && cost <= 2) << cost;
  }
}

TEST(PhotometricCostTest, OppositeTextureIsTheWorstMatch) {
  std::vector<PlanarView> views = RandomViews(2, 41, 31, 24);
  for (PlanarView& view : views) view.camera = {41, 31, 40, 40, 20, 15};
  views[1].cam_from_world = LookAhead({0.4, 0, 0}, 0, 0, 0);  // 4 px at depth 4
  views[1].gray = GrayImage(41, 31);
  for (int row = 0; row < 31; ++row) {
    for (int col = 0; col < 41; ++col) views[1].gray(col, row) = 255 - views[0].gray(std::min(col + 4, 40), row);
  }
  KernelState state(MakeProblem(views, 0, {1, 10}));
  EXPECT_NEAR(KernelCost(&state, {0, 0, -1, 4}, 20, 15, 0), 2.0, 1e-4);  // NCC = -1
  for (float& value : views[1].gray) value = 255 - value;
  EXPECT_NEAR(KernelCost(&state, {0, 0, -1, 4}, 20, 15, 0), 0.0, 1e-4);  // NCC = 1
}

}  // namespace
}  // namespace acmp
