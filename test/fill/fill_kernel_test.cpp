#include <tuple>
#include <utility>

#include "gtest/gtest.h"

#include "acmp_mapping/fill/fill.h"
#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "acmp_mapping/fill/kernel/weighted_median.h"
#include "fusion/analytic_views.h"

namespace acmp {
namespace {

/// Maps and seeds of an image in cells of 4 px.
class FillKernelTest : public ::testing::Test {
 protected:
  static constexpr int kWidth = 40, kHeight = 30, kCell = 4;

  FillKernelTest() {
    context_.rays = {1 / 50.0f, 1 / 52.0f, 19.5f, 14.5f};
    context_.depth_min = 1;
    context_.depth_max = 20;
    context_.seed_views = 2;
    context_.min_views = 2;
    context_.cell_size = kCell;
    context_.support = support_.View();
    context_.planes = planes_.View();
    context_.cost = cost_.View();
    context_.seeds = seeds_.View();
    context_.fitted = fitted_.View();
    context_.nearest = nearest_.View();
  }

  Vec3f Ray(int col, int row) const { return context_.rays.Ray(static_cast<float>(col), static_cast<float>(row)); }
  float DepthAt(const PlaneHypothesis& plane, int col, int row) const { return PlaneDepth(plane, Ray(col, row)); }
  void FindAll() {
    for (int row = 0; row < seeds_.height(); ++row) {
      for (int col = 0; col < seeds_.width(); ++col) FindSeed(context_, col, row, SingleThread());
    }
  }
  void FindAllNearest() {
    for (int row = 0; row < nearest_.height(); ++row) {
      for (int col = 0; col < nearest_.width(); ++col) {
        for (int i = 0; i < kNumDirections; ++i) FindNearestSeed(context_, col, row, i);
      }
    }
  }

  Image<ViewSupport> support_{kWidth, kHeight};
  PlaneMap planes_{kWidth, kHeight};
  CostMap cost_{kWidth, kHeight};
  Image<SeedCell> seeds_{CellsOf(kWidth, kCell), CellsOf(kHeight, kCell)}, fitted_{seeds_.width(), seeds_.height()};
  Image<NearestSeeds> nearest_{seeds_.width(), seeds_.height()};
  FillContext context_ = {};
};

TEST_F(FillKernelTest, ACloselyConfirmedSeedGoesBeforeANearerOneUpToEightTimesAsFarAndTwoCells) {
  const auto cell = [&](int col, int row) { return row * fitted_.width() + col; };
  const auto set = [&](int col, int row, bool is_strong) {
    fitted_(col, row).views = 3;
    fitted_(col, row).is_strong = is_strong;
  };
  // To the right of (0, row): a seed and a closely confirmed one.
  set(0, 0, false), set(2, 0, true);
  set(0, 1, false), set(3, 1, true);
  set(1, 2, false), set(2, 2, false), set(9, 2, true);
  set(1, 3, true), set(2, 3, true);
  set(4, 4, false);
  context_.strong_views = 4;
  FindAllNearest();
  EXPECT_EQ(nearest_(0, 0).cell[0], cell(2, 0));
  EXPECT_EQ(nearest_(0, 1).cell[0], cell(0, 1)) << "three steps instead of none";
  EXPECT_EQ(nearest_(0, 2).cell[0], cell(9, 2)) << "nine steps instead of one";
  EXPECT_EQ(nearest_(0, 3).cell[0], cell(1, 3)) << "the first of the sure ones";
  EXPECT_EQ(nearest_(0, 4).cell[0], cell(4, 4)) << "there is no other";
  EXPECT_EQ(nearest_(0, 5).cell[0], -1);
  context_.strong_views = 0;
  FindAllNearest();
  for (const auto& [row, col] : {std::pair(0, 0), {1, 0}, {2, 1}, {3, 1}, {4, 4}}) {
    EXPECT_EQ(nearest_(0, row).cell[0], cell(col, row)) << "the first one";
  }
}

TEST_F(FillKernelTest, WhatEnoughViewsConfirmCloselyIsTheSeedOfItsCell) {
  for (PlaneHypothesis& plane : planes_) plane = {0, 0, -1, 5};
  support_(8, 4) = PackViewSupport(9, 2, true, 0);
  support_(9, 4) = PackViewSupport(3, 3, true, 0);
  support_(16, 4) = PackViewSupport(4, 2, true, 0);
  context_.strong_views = 3;
  FindAll();
  EXPECT_TRUE(seeds_(2, 1).is_strong);
  EXPECT_EQ(seeds_(2, 1).col, 9) << "before one with nine views";
  EXPECT_EQ(seeds_(2, 1).views, 3);
  EXPECT_FALSE(seeds_(4, 1).is_strong);
  EXPECT_EQ(seeds_(4, 1).views, 4);
  context_.strong_views = 0;
  FindAll();
  EXPECT_FALSE(seeds_(2, 1).is_strong);
  EXPECT_EQ(seeds_(2, 1).views, 9);
}

/// Two walls, and what is on neither, around the pixel (20, 15).
class ElectionTest : public FillKernelTest {
 protected:
  static constexpr int kCol = 20, kRow = 15;
  const Vec3f wall_ = {0.1f, 0, 0.3f}, other_wall_ = {-0.05f, 0, 0.15f}, between_ = {0, 0, 0.22f};  ///< inverse planes

  ElectionTest() {
    for (int& cell : nearest_at_.cell) cell = -1;
  }

  /// A seed so far from the pixel, that lies on `surface` and whose own plane is `plane`.
  void Set(int direction, int dx, int dy, const Vec3f& surface, const Vec3f& plane) {
    SeedCell& seed = fitted_.data()[direction];
    seed = {3, kCol + dx, kRow + dy, 0, plane};
    seed.inverse_depth = InverseDepthAt(context_.rays, surface, seed);
    nearest_at_.cell[direction] = direction;
  }

  ExtendedPlanes Extended() const {
    ExtendedPlanes planes;
    FindExtendedPlanes(context_, nearest_at_, kCol, kRow, &planes);
    return planes;
  }

  NearestSeeds& nearest_at_ = nearest_(kCol / kCell, kRow / kCell);
};

TEST_F(ElectionTest, ThePlaneOnWhichMostSeedsLieIsElectedWhateverTheirOwnPlanesAre) {
  Set(0, 10, 0, wall_, wall_), Set(4, 0, 10, wall_, wall_), Set(8, -10, 0, wall_, between_);
  Set(12, 0, -10, other_wall_, other_wall_), Set(2, 6, 8, other_wall_, other_wall_);
  Set(6, -6, -8, {0, 0, 0.23f}, {0, 0, 0.23f});
  EXPECT_EQ(ElectPlane(context_, nearest_at_, Extended()), 0);
  EXPECT_EQ(MedianPlane(Extended()), 8) << "half of the weight lies up to there: on no surface";

  Set(3, 8, -6, other_wall_, between_), Set(5, -8, 6, other_wall_, wall_);
  EXPECT_EQ(ElectPlane(context_, nearest_at_, Extended()), 2) << "four to three, the first of two with this plane";

  planes_(kCol, kRow) = {0, 0, -1, 2};
  context_.strong_views = 3;
  FillPixel(context_, kCol, kRow);
  EXPECT_FLOAT_EQ(DepthAt(planes_(kCol, kRow), kCol, kRow), 1 / Dot(other_wall_, Ray(kCol, kRow)));
  context_.strong_views = 0;
  FillPixel(context_, kCol, kRow);
  EXPECT_FLOAT_EQ(DepthAt(planes_(kCol, kRow), kCol, kRow), 1 / between_.z) << "after the passes the median";
}

TEST_F(ElectionTest, NearSeedsHaveMoreOfASayAndSeedsThatLieOffTheirOwnPlaneDoNotElectIt) {
  // Ten times as far, in cells of 4 px: each weighs exp(-22.5 / (6 + 0.6 * 2.5)), a twentieth.
  Set(0, 100, 0, wall_, wall_), Set(4, 0, 100, wall_, wall_), Set(8, -100, 0, wall_, wall_);
  Set(12, 0, -10, other_wall_, other_wall_);
  EXPECT_EQ(ElectPlane(context_, nearest_at_, Extended()), 12);
  Set(12, 0, -10, other_wall_, between_);
  EXPECT_EQ(ElectPlane(context_, nearest_at_, Extended()), 0) << "a fit that misses its own seed";
}

/// What one source sees of the middle of a wall 5 m away, if its map says so many times the true depth.
ViewSupport LookAtAWallSeenAt(float factor) {
  const std::vector<Quad> wall = {{{-10, -10, 5}, {20, 0, 0}, {0, 20, 0}, {90, 90, 90}}};
  const PinholeCamera camera = {81, 61, 80, 80, 40, 30};
  TestView reference = Render(camera, LookAt({0, 0, 0}, {0, 0, 5}), wall);
  TestView source = Render(camera, LookAt({0.1, 0, 0}, {0.1, 0, 5}), wall);
  for (float& depth : source.depth) depth *= factor;
  const PlaneMap planes(81, 61);  // planes without normals: the nearest pixel's depth counts
  const auto maps_of = [&](const TestView& view) -> FusionMaps {
    return {view.depth.View(), planes.View(), view.cost.View(), {}};
  };
  FusionSetup setup({camera, reference.cam_from_world}, maps_of(reference), ConsistencyLimits(),
                    RigidTransform::Identity());
  setup.AddSource({camera, source.cam_from_world}, maps_of(source), {});
  return CountSupportingViews(setup.Context(setup.sources().data()), 40, 30);
}

TEST(CountSupportingViewsTest, TellsCloseConfirmationFromConfirmationAndThatFromNearlyOne) {
  // Of depth, 0.2 % are close, 0.3 % confirm, 1.2 % nearly do. A disparity of 1.6 px hardly changes by that.
  for (const float sign : {1.0f, -1.0f}) {
    for (const auto& [off, confirming, closely, nearly] : {std::tuple(0.0f, 1, 1, true),
                                                           {0.0018f, 1, 1, true},
                                                           {0.0022f, 1, 0, true},
                                                           {0.0028f, 1, 0, true},
                                                           {0.0032f, 0, 0, true},
                                                           {0.0115f, 0, 0, true},
                                                           {0.0125f, 0, 0, false}}) {
      const ViewSupport support = LookAtAWallSeenAt(1 + sign * off);
      EXPECT_EQ(ConsistentViews(support), confirming) << sign * off;
      EXPECT_EQ(StrictlyConsistentViews(support), closely) << sign * off;
      EXPECT_EQ(IsLooselyConsistent(support), nearly) << sign * off;
    }
  }
  // What a source sees more than 3 % farther away violates free space.
  for (const auto& [factor, violations] : {std::pair(1.0f, 0), {1.027f, 0}, {1.033f, 1}, {0.9f, 0}}) {
    EXPECT_EQ(FreeSpaceViolations(LookAtAWallSeenAt(factor)), violations) << factor;
  }
}

/// Two walls side by side at depths of 4 and 2, white and black.
class FilterPixelTest : public ::testing::Test {
 protected:
  static constexpr int kSize = 60, kEdge = 30;

  FilterPixelTest()
      : planes_(kSize, kSize),
        depth_(kSize, kSize),
        support_(kSize, kSize),
        color_(kSize, kSize),
        filtered_(kSize, kSize),
        cost_(kSize, kSize, 0.1f) {
    const RayGrid rays = {1 / 50.0f, 1 / 50.0f, 29.5f, 29.5f};
    for (int row = 0; row < kSize; ++row) {
      for (int col = 0; col < kSize; ++col) {
        const bool is_left = col < kEdge;
        SetDepth(col, row, is_left ? 4.0f : 2.0f);
        color_(col, row) = is_left ? Rgb{255, 255, 255} : Rgb{0, 0, 0};
      }
    }
    context_ = {rays,        1, 20, planes_.View(), depth_.View(), support_.View(), color_.View(), filtered_.View(),
                cost_.View()};
  }

  void SetDepth(int col, int row, float depth) {
    planes_(col, row) = {0, 0, -1, depth};
    depth_(col, row) = depth;
  }
  float Filtered(int col, int row) {
    WeightedMedianPixel(context_, col, row);
    return filtered_(col, row).d;
  }

  PlaneMap planes_;
  DepthMap depth_;
  Image<ViewSupport> support_;
  ColorImage color_;
  PlaneMap filtered_;
  CostMap cost_;
  MedianContext context_ = {};
};

TEST_F(FilterPixelTest, WhatSourcesSeeThroughHasLessSay) {
  // All of the left half that the filter sees from there but a column of samples has the wrong depth: nine times the
  // weight of that column, and a quarter of it for each source that violates.
  const auto filtered_with = [&](int free_space_violations) {
    for (int row = 0; row < kSize; ++row) {
      for (int col = 13; col < kEdge; ++col) {
        SetDepth(col, row, 2);
        support_(col, row) = PackViewSupport(4, 4, false, free_space_violations);
      }
    }
    return Filtered(24, 30);
  };
  EXPECT_NEAR(filtered_with(0), 2, 1e-5f);
  EXPECT_NEAR(filtered_with(1), 2, 1e-5f);
  EXPECT_NEAR(filtered_with(2), 4, 1e-5f);
  EXPECT_NEAR(filtered_with(9), 4, 1e-5f);
  for (ViewSupport& support : support_) support = PackViewSupport(4, 4, false, 3);
  EXPECT_NEAR(Filtered(24, 30), 2, 1e-5f) << "the same of all changes nothing";
}

TEST_F(FilterPixelTest, PlanesThatFaceAwayTiltTooMuchOrLeaveTheRangeAreNotExtended) {
  const Vec3f from = context_.rays.Ray(36, 30), to = context_.rays.Ray(40, 30);
  const PlaneHypothesis slanted = PlaneThrough(Normalized(Vec3f{0.5f, 0, -1}), from, 4);
  const float extended = PlaneDepth(slanted, to);
  ASSERT_GT(extended, 4.1f);
  ASSERT_LT(extended, 4.4f);
  EXPECT_NEAR(ExtendedDepth(context_, slanted, to, 4), extended, 1e-5f);
  const PlaneHypothesis away = {-slanted.nx, -slanted.ny, -slanted.nz, -slanted.d};
  EXPECT_EQ(ExtendedDepth(context_, away, to, 4), 0);
  EXPECT_EQ(ExtendedDepth(context_, PlaneThrough(Normalized(Vec3f{1, 0, -0.3f}), from, 4), to, 4), 4) << "by over 10 %";
  context_.depth_max = 4.1f;
  EXPECT_EQ(ExtendedDepth(context_, slanted, to, 4), 4);
  context_.depth_max = 20;
  context_.depth_min = 4.9f;
  EXPECT_EQ(ExtendedDepth(context_, slanted, to, 4), 4);
}

}  // namespace
}  // namespace acmp
