#include "acmp_mapping/fill/fill.h"

#include <algorithm>
#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "fusion/analytic_views.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

const DepthRange kRange = {1, 30};

/// A room's corner: two walls that meet, seen by three cameras of 160 x 120 px side by side.
std::vector<TestView> Corner() {
  const std::vector<Quad> walls = {{{-2, 0, 6}, {8, 0, 4}, {0, 9, 0}, {90, 90, 90}},
                                   {{4, 0, 6}, {4, 0, -4}, {0, 9, 0}, {150, 150, 150}}};
  const PinholeCamera camera = {160, 120, 150, 150, 79.5, 59.5};
  std::vector<TestView> views;
  for (const double x : {0.0, 0.4, -0.4}) views.push_back(Render(camera, LookAt({x, 0, 0}, {x, 0, 5}), walls));
  return views;
}

PlaneMap PlanesOf(const TestView& view) {
  PlaneMap planes(view.camera.width, view.camera.height);
  const RayGrid rays = {static_cast<float>(1 / view.camera.fx), static_cast<float>(1 / view.camera.fy),
                        static_cast<float>(view.camera.cx), static_cast<float>(view.camera.cy)};
  for (int row = 0; row < planes.height(); ++row) {
    for (int col = 0; col < planes.width(); ++col) {
      planes(col, row) = PlaneThrough(view.normal(col, row), rays.Ray(static_cast<float>(col), static_cast<float>(row)),
                                      view.depth(col, row));
    }
  }
  return planes;
}

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

Filled Fill(const std::vector<TestView>& views, size_t num_sources, const FillOptions& options = WithoutMedian(),
            const DepthRange& range = kRange) {
  Filled result = {PlanesOf(views[0]), views[0].cost.Clone(), {}};
  std::vector<FusionView> sources;
  for (size_t i = 1; i <= num_sources; ++i) sources.push_back(views[i].View());
  FillUnverified(views[0].View(), sources, range, options, result.planes.View(), result.cost.View());
  const PinholeCamera& camera = views[0].camera;
  result.depth = DepthMap(camera.width, camera.height);
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const Vec3f ray = {static_cast<float>((col - camera.cx) / camera.fx),
                         static_cast<float>((row - camera.cy) / camera.fy), 1};
      result.depth(col, row) = PlaneDepth(result.planes(col, row), ray);
    }
  }
  return result;
}

/// Puts the reference's pixels of a rectangle at a depth that no other view has.
void Spoil(TestView* view, int first_col, int first_row, int last_col, int last_row) {
  for (int row = first_row; row <= last_row; ++row) {
    for (int col = first_col; col <= last_col; ++col) {
      view->depth(col, row) = 2.0f + 0.01f * static_cast<float>((7 * col + 13 * row) % 90);
      view->normal(col, row) = Normalized(Vec3f{0.3f * static_cast<float>(col % 3 - 1), 0.4f, -1});
    }
  }
}

TEST(FillTest, UnconfirmedPixelsTakeThePlaneOfTheirSurroundings) {
  std::vector<TestView> views = Corner();
  const DepthMap truth = views[0].depth.Clone();
  Spoil(&views[0], 30, 30, 75, 90);
  const DepthMap before = views[0].depth.Clone();
  const Filled after = Fill(views, 2);
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) {
      const bool spoilt = col >= 30 && col <= 75 && row >= 30 && row <= 90;
      if (after.depth(col, row) == before(col, row)) continue;
      if (!spoilt && after.cost(col, row) != kWorstCost) {
        ASSERT_NEAR(after.depth(col, row), before(col, row), 1e-4) << col << ", " << row;  // rounding of the plane
        continue;
      }
      if (!spoilt) continue;
      // The walls are exact planes; the fit is pulled to zero slope by a ten-thousandth.
      ASSERT_NEAR(after.depth(col, row), truth(col, row), 2e-3 * truth(col, row)) << col << ", " << row;
    }
  }
  int filled = 0;
  for (int row = 30; row <= 90; ++row) {
    for (int col = 30; col <= 75; ++col) filled += after.cost(col, row) == kWorstCost ? 1 : 0;
  }
  // Some of the bad depths may by chance agree with a source's pixel.
  EXPECT_GT(filled, 0.99 * 46 * 61);
}

TEST(FillTest, EachSideOfACornerIsExtendedFromItsOwnWall) {
  std::vector<TestView> views = Corner();
  const DepthMap truth = views[0].depth.Clone();
  Spoil(&views[0], 60, 20, 140, 50);
  const Filled after = Fill(views, 2);
  int good = 0, all = 0;
  for (int row = 20; row <= 50; ++row) {
    for (int col = 60; col <= 140; ++col) {
      ++all;
      good += std::fabs(after.depth(col, row) - truth(col, row)) < 0.02f * truth(col, row) ? 1 : 0;
    }
  }
  // Next to the edge either wall's plane is as likely: 16 directions tell sides apart to some 11 degrees.
  EXPECT_GT(good, 0.9 * all);
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

TEST(FillTest, WhatOneOfSevenViewsConfirmsTakesThePlaneOfItsSurroundings) {
  const std::vector<TestView> corner = Corner();
  // The reference, a source in its place, and six others beside it.
  std::vector<TestView> views;
  for (int i = 0; i < 8; ++i) views.push_back(CopyOf(corner[i < 2 ? 0 : 1]));
  const float wrong_by = 0.97f;                    // near enough for what one view nearly confirms
  for (TestView* view : {&views[0], &views[1]}) {  // which alone confirms what both have wrong
    for (int row = 30; row <= 90; ++row) {
      for (int col = 30; col <= 75; ++col) view->depth(col, row) *= wrong_by;
    }
  }
  FillOptions options = WithoutMedian();
  options.for_passes = false;  // in the walls' seam no pixel is confirmed closely
  const Filled of_seven = Fill(views, 7, options), of_six = Fill(views, 6, options);
  int filled = 0;
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) {
      const bool wrong = col >= 30 && col <= 75 && row >= 30 && row <= 90;
      const float truth = corner[0].depth(col, row);
      if (wrong) {
        ASSERT_NEAR(of_six.depth(col, row), truth * wrong_by, 1e-4f * truth) << "one of six suffices";
      }
      if (of_seven.cost(col, row) != kUnverifiedCost) continue;
      filled += wrong ? 1 : 0;
      // The walls are exact planes; the fit is pulled to zero slope by a ten-thousandth.
      ASSERT_NEAR(of_seven.depth(col, row), truth, 2e-3f * truth) << col << ", " << row;
    }
  }
  EXPECT_GT(filled, 0.99 * 46 * 61);
}

TEST(FillTest, WhatAViewNearlyConfirmsIsNotTakenForAnotherSurface) {
  const std::vector<TestView> corner = Corner();
  const int first = 30, last = 60;
  const auto fill_apart = [&](float apart) {
    std::vector<TestView> views;  // the reference, a source in its place, and one beside it
    for (const size_t i : {0, 0, 1}) views.push_back(CopyOf(corner[i]));
    for (int row = first; row <= last; ++row) {
      for (int col = first; col <= last; ++col) {
        views[0].depth(col, row) *= 0.7f;  // nothing around is so near
        views[1].depth(col, row) *= 0.7f * apart;
      }
    }
    return Fill(views, 2, WithoutMedian());
  };
  const Filled kept = fill_apart(1.01f), filled = fill_apart(1.03f);
  for (int row = first; row <= last; ++row) {
    for (int col = first; col <= last; ++col) {
      const float truth = corner[0].depth(col, row);
      ASSERT_NEAR(kept.depth(col, row), 0.7f * truth, 1e-5f * truth) << "1 % is less than four times 0.3 %";
      ASSERT_EQ(kept.cost(col, row), corner[0].cost(col, row));
      // The walls are exact planes; the fit is pulled to zero slope by a ten-thousandth.
      ASSERT_NEAR(filled.depth(col, row), truth, 2e-3f * truth) << "and 3 % is more";
      ASSERT_EQ(filled.cost(col, row), kWorstCost);
    }
  }
}

/// A grey board in front of a white wall, seen from the middle and from both sides.
std::vector<TestView> Board() {
  const std::vector<Quad> surfaces = {{{0, 0, 6}, {9, 0, 0}, {0, 9, 0}, {250, 250, 250}},
                                      {{0, 0, 3}, {0.5, 0, 0}, {0, 9, 0}, {90, 90, 90}}};
  const PinholeCamera camera = {160, 120, 150, 150, 79.5, 59.5};
  std::vector<TestView> views;
  for (const double x : {0.0, 1.5, -1.5}) views.push_back(Render(camera, LookAt({x, 0, 0}, {x, 0, 5}), surfaces));
  return views;
}

TEST(FillTest, WhatASourceLooksThroughTakesTheSurfaceOfItsColour) {
  std::vector<TestView> views = Board();
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
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) {
      if (!is_beside(col, row)) continue;
      ++beside;
      views[0].depth(col, row) = 3;
    }
  }
  ASSERT_EQ(beside, 12 * 120);
  const Filled with = Fill(views, 2, {}), without = Fill(views, 2);
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) {
      if (without.cost(col, row) == kWorstCost) continue;  // a guess: no source sees the place
      // All planes face the cameras: extended they have the same depth but for the rounding of a quotient.
      ASSERT_NEAR(with.depth(col, row), truth(col, row), 1e-5f * truth(col, row)) << col << ", " << row;
      if (is_beside(col, row)) {
        ASSERT_NEAR(without.depth(col, row), 3, 1e-5f) << "the board is confirmed beside itself, too";
        EXPECT_GE(with.cost(col, row), kUnverifiedCost) << "its cost was that of another surface";
      } else {
        EXPECT_EQ(with.cost(col, row), without.cost(col, row));
      }
    }
  }
}

TEST(FillTest, BadInputIsRefused) {
  const std::vector<TestView> views = Corner();
  try {
    Fill(views, 2, {}, {3, 2});
    ADD_FAILURE() << "accepted";
  } catch (const InvalidInputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("depth range"));
  }
}

TEST(FillTest, NothingChangesWithoutSourcesOrSeeds) {
  std::vector<TestView> views = Corner();
  const PlaneMap before = PlanesOf(views[0]);
  const auto unchanged = [&](const Filled& after) {
    for (int row = 0; row < 120; ++row) {
      for (int col = 0; col < 160; ++col) {
        if (after.planes(col, row).d != before(col, row).d) return false;
      }
    }
    return true;
  };
  EXPECT_TRUE(unchanged(Fill(views, 0)));
  for (TestView& view : views) {
    if (&view != &views[0]) view.depth = DepthMap(160, 120, 20.0f);  // confirms nothing
  }
  EXPECT_TRUE(unchanged(Fill(views, 2)));
  views[1].depth = {};
  views[2].depth = {};
  EXPECT_TRUE(unchanged(Fill(views, 2)));
}

TEST(FillTest, PlanesAreNotExtendedBeyondTheDepthRange) {
  std::vector<TestView> views = Corner();
  Spoil(&views[0], 30, 30, 75, 90);
  const DepthRange narrow = {1, 5};
  for (const bool weighted_median : {false, true}) {
    FillOptions options;
    options.weighted_median = weighted_median;
    const Filled after = Fill(views, 2, options, narrow);
    for (int row = 30; row <= 90; ++row) {
      for (int col = 30; col <= 75; ++col) ASSERT_LE(after.depth(col, row), narrow.max * 1.0001f);
    }
  }
}

}  // namespace
}  // namespace acmp
