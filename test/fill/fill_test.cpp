// What FillUnverified makes of exact maps that are wrong in a part, on every device.

#include <algorithm>
#include <cmath>
#include <utility>

#include "gmock/gmock.h"

#include "fusion/engine_views.h"
#include "support/devices.h"
#include "support/pass_result.h"

namespace acmp {
namespace {

const DepthRange kRange = {1, 30};

/// Seen by three cameras of 160 x 120 px side by side, the reference in the middle.
std::vector<TestView> FromThreePlaces(const std::vector<Quad>& surfaces, double apart) {
  const PinholeCamera camera = {160, 120, 150, 150, 79.5, 59.5};
  std::vector<TestView> views;
  for (const double x : {0.0, apart, -apart}) views.push_back(Render(camera, LookAt({x, 0, 0}, {x, 0, 5}), surfaces));
  return views;
}

/// A room's corner: two walls that meet.
std::vector<TestView> Corner() {
  return FromThreePlaces(
      {{{-2, 0, 6}, {8, 0, 4}, {0, 9, 0}, {90, 90, 90}}, {{4, 0, 6}, {4, 0, -4}, {0, 9, 0}, {150, 150, 150}}}, 0.4);
}

template <class Function>
void ForEachPixel(const Function& function) {
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) function(col, row);
  }
}

/// A rectangle of pixels, the last ones included.
struct Part {
  int first_col, first_row, last_col, last_row;
  bool Contains(int col, int row) const {
    return col >= first_col && col <= last_col && row >= first_row && row <= last_row;
  }
  int size() const { return (last_col - first_col + 1) * (last_row - first_row + 1); }
};
constexpr Part kPart = {30, 30, 75, 90};

/// The walls are exact planes; the fit is pulled to zero slope by a ten-thousandth.
constexpr float kOfFit = 2e-3f;

struct Filled {
  PlaneMap planes;
  CostMap cost;
  DepthMap depth;
};

FillOptions WithoutMedian() {
  FillOptions options;
  options.weighted_median = false;
  return options;
}

/// Of the first view against those after it.
EngineProblem ProblemOf(const std::vector<TestView>& views, size_t num_sources, const DepthRange& range,
                        DepthEngine* engine) {
  EngineProblem problem = {{}, UploadViews(views, engine), range};
  problem.reference = problem.sources.front();
  problem.sources.erase(problem.sources.begin());
  problem.sources.resize(num_sources);
  return problem;
}

class FillTest : public EngineTest {
 protected:
  Filled Fill(const std::vector<TestView>& views, size_t num_sources, const FillOptions& options = WithoutMedian(),
              const DepthRange& range = kRange) {
    const EngineProblem problem = ProblemOf(views, num_sources, range, engine_.get());
    const EngineEstimatePtr filled = engine_->FillUnverified(problem, problem.reference.estimate, options);
    EstimateState state = engine_->DownloadState(filled);
    return {std::move(state.planes), std::move(state.cost), engine_->DownloadDepth(filled)};
  }
};
INSTANTIATE_TEST_SUITE_P(Devices, FillTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

/// Puts the reference's pixels at a depth that no other view has.
void Spoil(TestView* view, const Part& part) {
  ForEachPixel([&](int col, int row) {
    if (!part.Contains(col, row)) return;
    view->depth(col, row) = 2.0f + 0.01f * static_cast<float>((7 * col + 13 * row) % 90);
    view->normal(col, row) = Normalized(Vec3f{0.3f * static_cast<float>(col % 3 - 1), 0.4f, -1});
  });
}

TEST_P(FillTest, UnconfirmedPixelsTakeThePlaneOfTheirSurroundings) {
  std::vector<TestView> views = Corner();
  const DepthMap truth = views[0].depth.Clone();
  Spoil(&views[0], kPart);
  const DepthMap before = views[0].depth.Clone();
  const Filled after = Fill(views, 2);
  int filled = 0;
  ForEachPixel([&](int col, int row) {
    const bool spoilt = kPart.Contains(col, row);
    filled += spoilt && after.cost(col, row) == kWorstCost ? 1 : 0;
    if (after.depth(col, row) == before(col, row)) return;
    if (spoilt) {
      ASSERT_NEAR(after.depth(col, row), truth(col, row), kOfFit * truth(col, row)) << col << ", " << row;
    } else if (after.cost(col, row) != kWorstCost) {
      ASSERT_NEAR(after.depth(col, row), before(col, row), 1e-4) << col << ", " << row;  // rounding of the plane
    }
  });
  // Some of the bad depths may by chance agree with a source's pixel.
  EXPECT_GT(filled, 0.99 * kPart.size());
}

TEST_P(FillTest, EachSideOfACornerIsExtendedFromItsOwnWall) {
  constexpr Part kCorner = {60, 20, 140, 50};
  std::vector<TestView> views = Corner();
  const DepthMap truth = views[0].depth.Clone();
  Spoil(&views[0], kCorner);
  const Filled after = Fill(views, 2);
  int good = 0;
  ForEachPixel([&](int col, int row) {
    if (!kCorner.Contains(col, row)) return;
    good += std::fabs(after.depth(col, row) - truth(col, row)) < 0.02f * truth(col, row) ? 1 : 0;
  });
  // Next to the edge either wall's plane is as likely: 16 directions tell sides apart to some 11 degrees.
  EXPECT_GT(good, 0.9 * kCorner.size());
}

TestView CopyOf(const TestView& view) {
  TestView copy;
  copy.camera = view.camera;
  copy.cam_from_world = view.cam_from_world;
  copy.depth = view.depth.Clone();
  copy.normal = view.normal.Clone();
  copy.cost = view.cost.Clone();
  copy.color = view.color.Clone();
  return copy;
}

/// The corner from its own place, so many times, with the first two maps wrong in a part by these factors.
std::vector<TestView> WrongInPart(size_t count, float reference, float source) {
  const std::vector<TestView> corner = Corner();
  std::vector<TestView> views;  // the reference, a source in its place, and others beside it
  for (size_t i = 0; i < count; ++i) views.push_back(CopyOf(corner[i < 2 ? 0 : 1]));
  ForEachPixel([&](int col, int row) {
    if (!kPart.Contains(col, row)) return;
    views[0].depth(col, row) *= reference;
    views[1].depth(col, row) *= source;
  });
  return views;
}

TEST_P(FillTest, WhatOneOfSevenViewsConfirmsTakesThePlaneOfItsSurroundings) {
  const float wrong_by = 0.97f;  // near enough for what one view nearly confirms
  const std::vector<TestView> views = WrongInPart(8, wrong_by, wrong_by);
  FillOptions options = WithoutMedian();
  options.for_passes = false;  // in the walls' seam no pixel is confirmed closely
  const Filled of_seven = Fill(views, 7, options), of_six = Fill(views, 6, options);
  const DepthMap truth = std::move(Corner()[0].depth);
  int filled = 0;
  ForEachPixel([&](int col, int row) {
    const float z = truth(col, row);
    if (kPart.Contains(col, row)) {
      ASSERT_NEAR(of_six.depth(col, row), z * wrong_by, 1e-4f * z) << "one of six suffices";
    }
    if (of_seven.cost(col, row) != kUnverifiedCost) return;
    filled += kPart.Contains(col, row) ? 1 : 0;
    ASSERT_NEAR(of_seven.depth(col, row), z, kOfFit * z) << col << ", " << row;
  });
  EXPECT_GT(filled, 0.99 * kPart.size());
}

TEST_P(FillTest, WhatAViewNearlyConfirmsIsNotTakenForAnotherSurface) {
  const auto fill_apart = [this](float apart) {  // nothing around is so near
    return Fill(WrongInPart(3, 0.7f, 0.7f * apart), 2);
  };
  const Filled kept = fill_apart(1.01f), filled = fill_apart(1.03f);
  const TestView truth = std::move(Corner()[0]);
  ForEachPixel([&](int col, int row) {
    if (!kPart.Contains(col, row)) return;
    const float z = truth.depth(col, row);
    ASSERT_NEAR(kept.depth(col, row), 0.7f * z, 1e-5f * z) << "1 % is less than four times 0.3 %";
    ASSERT_EQ(kept.cost(col, row), truth.cost(col, row));
    ASSERT_NEAR(filled.depth(col, row), z, kOfFit * z) << "and 3 % is more";
    ASSERT_EQ(filled.cost(col, row), kWorstCost);
  });
}

TEST_P(FillTest, WhatASourceSeesThroughTakesTheSurfaceOfItsColour) {
  // A grey board in front of a white wall, from the middle and from both sides.
  std::vector<TestView> views = FromThreePlaces(
      {{{0, 0, 6}, {9, 0, 0}, {0, 9, 0}, {250, 250, 250}}, {{0, 0, 3}, {0.5, 0, 0}, {0, 9, 0}, {90, 90, 90}}}, 1.5);
  const DepthMap truth = views[0].depth.Clone();
  // A window that the board's edge outweighs: six pixels of the wall on either side have the board's depth.
  const auto is_beside = [&](int col, int row) {
    if (truth(col, row) < 4) return false;
    for (int other = std::max(0, col - 6); other <= std::min(159, col + 6); ++other) {
      if (truth(other, row) < 4) return true;
    }
    return false;
  };
  int beside = 0;
  ForEachPixel([&](int col, int row) {
    if (!is_beside(col, row)) return;
    ++beside;
    views[0].depth(col, row) = 3;
  });
  ASSERT_EQ(beside, 12 * 120);
  const Filled with = Fill(views, 2, {}), without = Fill(views, 2);
  ForEachPixel([&](int col, int row) {
    if (without.cost(col, row) == kWorstCost) return;  // no source sees the place
    // All planes face the cameras: extended they have the same depth but for the rounding of a quotient.
    ASSERT_NEAR(with.depth(col, row), truth(col, row), 1e-5f * truth(col, row)) << col << ", " << row;
    if (is_beside(col, row)) {
      ASSERT_NEAR(without.depth(col, row), 3, 1e-5f) << "the board is confirmed beside itself, too";
      EXPECT_GE(with.cost(col, row), kUnverifiedCost) << "its cost was that of another surface";
    } else {
      EXPECT_EQ(with.cost(col, row), without.cost(col, row));
    }
  });
}

TEST_P(FillTest, NothingChangesWithoutSourcesOrSeeds) {
  std::vector<TestView> views = Corner();
  const EstimateState before = engine_->DownloadState(ProblemOf(views, 0, kRange, engine_.get()).reference.estimate);
  EXPECT_TRUE(SamePixels(Fill(views, 0).planes, before.planes));
  for (size_t i = 1; i < 3; ++i) views[i].depth = DepthMap(160, 120, 20.0f);  // confirms nothing
  EXPECT_TRUE(SamePixels(Fill(views, 2).planes, before.planes));
  for (size_t i = 1; i < 3; ++i) views[i].depth = {};
  EXPECT_TRUE(SamePixels(Fill(views, 2).planes, before.planes));
}

TEST_P(FillTest, GivesTheSameBitsAgainAndLeavesAStartThatIsHeldAsItWas) {
  std::vector<TestView> views = NoisyViews();
  for (int row = 10; row < 40; ++row) {
    for (int col = 20; col < 50; ++col) views[0].depth(col, row) *= 1.5f;
  }
  EngineProblem problem = ProblemOf(views, 3, kRange, engine_.get());
  const auto fill = [&](EngineEstimatePtr start) {
    return engine_->DownloadState(engine_->FillUnverified(problem, std::move(start), {}));
  };
  const EstimateState before = engine_->DownloadState(problem.reference.estimate);
  const EstimateState first = fill(problem.reference.estimate);
  EXPECT_TRUE(SameBits(fill(problem.reference.estimate), first));
  EXPECT_TRUE(SameBits(engine_->DownloadState(problem.reference.estimate), before));
  EXPECT_FALSE(SameBits(first, before));
  EXPECT_TRUE(SameBits(fill(std::move(problem.reference.estimate)), first)) << "now nobody else holds it";
}

TEST_P(FillTest, PlanesAreNotExtendedBeyondTheDepthRange) {
  std::vector<TestView> views = Corner();
  Spoil(&views[0], kPart);
  const DepthRange narrow = {1, 5};
  for (const bool weighted_median : {false, true}) {
    FillOptions options;
    options.weighted_median = weighted_median;
    const Filled after = Fill(views, 2, options, narrow);
    ForEachPixel([&](int col, int row) {
      if (!kPart.Contains(col, row)) return;
      ASSERT_LE(after.depth(col, row), narrow.max * 1.0001f);
    });
  }
}

}  // namespace
}  // namespace acmp
