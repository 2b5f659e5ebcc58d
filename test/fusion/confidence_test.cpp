#include <gtest/gtest.h>

#include <cmath>

#include "fusion/analytic_views.h"
#include "fusion/engine_views.h"
#include "fusion/fusion_contexts.h"
#include "fusion/reference_fusion.h"

namespace acmp {
namespace {

double ProbabilityOf(double log_odds) { return 1 / (1 + std::exp(-log_odds)); }

TEST(LogOddsOf, HasTheDocumentedValues) {
  // -7 - 1.74 ln(u + 0.01) + 2.22 a - 1.59 s / v, worked out by hand to six digits.
  EXPECT_NEAR(LogOddsOf({}, 0), 1.012996, 1e-6);
  EXPECT_NEAR(LogOddsOf({2, 0, 1}, 0), 3.232996, 1e-6);
  EXPECT_NEAR(LogOddsOf({3, 3, 0}, 0), -0.577004, 1e-6);
  EXPECT_NEAR(LogOddsOf({4, 1, 0.5}, 0.02), -0.186089, 1e-6);
  EXPECT_NEAR(LogOddsOf({}, kMaxUnevenness), -3.159342, 1e-6);
}

TEST(GradedAgreement, FallsWithErrorsAndNarrowAngles) {
  const auto versine = [](double deg) { return 1 - std::cos(deg * M_PI / 180); };
  EXPECT_NEAR(GradedAgreement(0, 0, versine(10)), 1, 1e-8);  // the constant has 9 digits
  EXPECT_DOUBLE_EQ(GradedAgreement(0, 0, versine(60)), 1);
  EXPECT_DOUBLE_EQ(GradedAgreement(0.5, 0.01, versine(11)), std::exp(-2.5));
  // The constant has 9 digits.
  EXPECT_NEAR(GradedAgreement(0, 0, versine(4)), std::sin(2 * M_PI / 180) / std::sin(5 * M_PI / 180), 1e-8);
  EXPECT_EQ(GradedAgreement(0, 0, 0), 0);
  EXPECT_EQ(GradedAgreement(0, 0, -1e-16), 0);  // rounding of 1 - cos
  EXPECT_EQ(GradedAgreement(0, 0.11, versine(10)), 0);
  EXPECT_EQ(GradedAgreement(kNan, 0, versine(10)), 0);
}

/// Of the pixel in the middle of a map without source views.
double UnevennessOfMiddle(const TestView& view) {
  const FusionContexts contexts({view.View()}, {{}}, {});
  ReferencePixel pixel;
  if (!LoadReferencePixel(contexts[0], view.camera.width / 2, view.camera.height / 2, &pixel)) return kNan;
  return SurfaceUnevenness(contexts[0], pixel);
}

TEST(SurfaceUnevenness, IsTheMeanDeviationFromThePixelsPlane) {
  const Quad slanted = {{0, 0, 5}, {9, 0, 3}, {0, 9, 1}, {}};
  TestView view = Render({61, 51, 70, 75, 30.2, 25.4}, LookAt({0, 0, 0}, {0, 0, 5}), {slanted});
  EXPECT_NEAR(UnevennessOfMiddle(view), 0, 2e-7);  // depth and normal in float
  // Two of the 24 neighbours: 2 % farther, and far enough to count as another surface.
  view.depth(30 + 8, 25) *= 1.02f;
  view.depth(30 - 12, 25 - 12) *= 3;
  EXPECT_NEAR(UnevennessOfMiddle(view), (0.02 + kMaxUnevenness) / 24, 2e-7);
  view.depth(30 + 3, 25 + 3) = 0;  // unknown: does not count
  EXPECT_NEAR(UnevennessOfMiddle(view), (0.02 + kMaxUnevenness) / 23, 2e-7);
  view.depth(30 + 1, 25) = 9;  // not looked at
  EXPECT_NEAR(UnevennessOfMiddle(view), (0.02 + kMaxUnevenness) / 23, 2e-7);
}

TEST(SurfaceUnevenness, ComparesWithWhatHasThePixelsColour) {
  // A post of 7 px in front of a wall. Ten of the 24 neighbours are on it: the six straight above and below, and the
  // four nearest diagonal ones, which are 3 px across.
  const auto post = [](Rgb color) {
    TestView view = FlatView(61, 41, 4);
    for (int row = 0; row < 41; ++row) {
      for (int col = 27; col <= 33; ++col) {
        view.depth(col, row) = 3;
        view.color(col, row) = color;
      }
    }
    return view;
  };
  const TestView red = post({200, 0, 0}), black = post({0, 0, 0});
  const double weight = 400 / (400 + 200.0 * 200);
  EXPECT_NEAR(UnevennessOfMiddle(red), 0.1 * 14 * weight / (10 + 14 * weight), 1e-9);
  EXPECT_NEAR(UnevennessOfMiddle(black), 0.1 * 14 / 24, 1e-9);
  // A black pixel of the wall with the red post's depth.
  TestView wrong = post({200, 0, 0});
  wrong.color(30, 20) = {0, 0, 0};
  EXPECT_NEAR(UnevennessOfMiddle(wrong), 0.1 * 14 / (10 * weight + 14), 1e-9);
  wrong.color = ColorImage();
  EXPECT_NEAR(UnevennessOfMiddle(wrong), 0.1 * 14 / 24, 1e-9) << "without colours all count the same";
}

TEST(SurfaceUnevenness, IsTheWorstWhereNothingCanBeCompared) {
  EXPECT_EQ(UnevennessOfMiddle(FlatView(5, 5, 4)), kMaxUnevenness);  // all neighbours are outside
  TestView view = FlatView(41, 41, 4);
  EXPECT_NEAR(UnevennessOfMiddle(view), 0, 1e-12);
  view.normal(20, 20) = {0, 0, 1};  // faces away
  EXPECT_EQ(UnevennessOfMiddle(view), kMaxUnevenness);
}

/// Flat maps of these depths, seen from a place beside the reference's.
std::vector<TestView> SideViews(const std::vector<float>& depths) {
  std::vector<TestView> views;
  views.reserve(depths.size());
  for (const float depth : depths) {
    views.push_back(FlatView(61, 41, depth));
    views.back().cam_from_world.translation().x() = -0.8;  // 11 degrees at a depth of 4
  }
  return views;
}

/// A pixel that SideViews see with all that is around it, 20 px further to the left.
constexpr int kCol = 44, kRow = 20;

double ConfidenceOf(const TestView& reference, const std::vector<TestView>& sources) {
  return FilterByConsistency(reference.View(), ViewsOf(sources), {}).confidence(kCol, kRow);
}

TEST(FilterByConsistency, ConfidenceCountsWhoSeesThePixel) {
  const TestView wall = FlatView(61, 41, 4);
  const double all = ProbabilityOf(LogOddsOf({2, 0, 1}, 0));
  EXPECT_NEAR(ConfidenceOf(wall, SideViews({4, 4})), all, 1e-7);  // float
  // The best view counts, whether the others see an occluder or look through.
  EXPECT_NEAR(ConfidenceOf(wall, SideViews({4, 4, 3})), all, 1e-7);
  EXPECT_NEAR(ConfidenceOf(wall, SideViews({5, 4})), all, 1e-7);
  EXPECT_NEAR(ConfidenceOf(wall, SideViews({5, 3})), ProbabilityOf(LogOddsOf({2, 0, 0}, 0)), 1e-7);
  // Neither an unknown depth nor a guess confirms.
  std::vector<TestView> sources = SideViews({4, 0, 4});
  sources[2].cost = CostMap(61, 41, kWorstCost);
  EXPECT_NEAR(ConfidenceOf(wall, sources), ProbabilityOf(LogOddsOf({3, 2, 1}, 0)), 1e-7);
}

TEST(FilterByConsistency, ConfidenceIsThatOfTheSurfaceAround) {
  // Without a normal a pixel has the odds of the worst unevenness, and its depth speaks for what is around all the
  // same.
  const auto expected = [](double share_of_worst) {
    return ProbabilityOf(LogOddsOf({}, 0) + share_of_worst * (LogOddsOf({}, kMaxUnevenness) - LogOddsOf({}, 0)));
  };
  constexpr Vec3f kUnknown = {0, 0, 0};
  TestView wall = FlatView(61, 41, 4);
  wall.normal(kCol, kRow) = kUnknown;
  EXPECT_NEAR(ConfidenceOf(wall, {}), expected(1 / 25.0), 1e-7);
  wall.normal(kCol + 16, kRow) = wall.normal(kCol - 3, kRow + 3) = wall.normal(kCol, kRow - 8) = kUnknown;
  wall.normal(kCol + 1, kRow) = kUnknown;  // not looked at
  EXPECT_NEAR(ConfidenceOf(wall, {}), expected(4 / 25.0), 1e-7);
  wall.depth(kCol + 6, kRow + 6) = 0;  // unknown
  EXPECT_NEAR(ConfidenceOf(wall, {}), expected(4 / 24.0), 1e-7);
  // Two pixels that count less, of which one is bad.
  wall.color = ColorImage(61, 41, {90, 90, 90});
  wall.color(kCol + 16, kRow) = wall.color(kCol - 16, kRow) = {90, 110, 90};
  EXPECT_NEAR(ConfidenceOf(wall, {}), expected(3.5 / 23.0), 1e-7);
  wall.depth(kCol, kRow) = 0;
  EXPECT_EQ(ConfidenceOf(wall, {}), 0);
}

TEST(FilterByConsistency, AnotherSurfaceDoesNotCountForConfidence) {
  // Half of what is around lies 20 % nearer: it makes the pixel uneven, but its own odds do not matter.
  const auto confidence = [](const Vec3f& normal_of_nearer) {
    TestView view = FlatView(61, 41, 4);
    for (int row = 0; row < 41; ++row) {
      for (int col = kCol + 1; col < 61; ++col) {
        view.depth(col, row) = 3.2f;
        view.normal(col, row) = normal_of_nearer;
      }
    }
    return ConfidenceOf(view, {});
  };
  EXPECT_EQ(confidence({0, 0, -1}), confidence({0, 0, 0}));
  EXPECT_LT(confidence({0, 0, -1}), ConfidenceOf(FlatView(61, 41, 4), {}));
}

TEST(DepthAtPlace, IsExactOnAFloorSeenAtASlant) {
  // 1.5 below two cameras that look ahead, with rows that are 0.4 px apart: depths of neighbouring pixels differ by
  // percents.
  const Quad floor = {{0, 1.5, 0}, {50, 0, 0}, {0, 0, 50}, {}};
  std::vector<TestView> views;
  views.push_back(Render({40, 60, 100, 100, 19.5, 10.2}, LookAt({0, 0, 0}, {0, 0, 1}), {floor}));
  views.push_back(Render({40, 60, 100, 100, 19.5, 10.6}, LookAt({0.3, 0, 0}, {0.3, 0, 1}), {floor}));
  const FusionContexts contexts(ViewsOf(views), {{1}, {}}, {});
  const FusionSource<HostMaps>& source = contexts[0].sources[0];
  int exact = 0, nearest = 0;
  contexts.ForEachPixel(0, [&](int col, int row) {
    ReferencePixel pixel;
    SourcePlace place;
    if (!LoadReferencePixel(contexts[0], col, row, &pixel)) return;
    if (!LocateInSource(source, pixel.homogeneous, &place)) return;
    const float of_nearest = source.view.Depth(place.col, place.row);
    const double depth = DepthAtPlace(source, place, of_nearest), ratio = place.depth / of_nearest;
    if (std::abs(ratio - 1) > 0.0501) {  // too far from the pixel's own
      ASSERT_EQ(depth, of_nearest);
      ++nearest;
    } else if (std::abs(ratio - 1) < 0.0499) {
      ASSERT_NEAR(depth, place.depth, 1e-5 * place.depth);  // normals in float, whose errors the slant enlarges
      exact += std::abs(ratio - 1) > 0.01;
    }
  });
  EXPECT_GT(exact, 200);
  EXPECT_GT(nearest, 20);
}

TEST(DepthAtPlace, IsTheNearestPixelsWithoutAPlaneThatFacesTheCamera) {
  TestView view = FlatView(9, 7, 4);
  const SourcePlace place = {4.3, 2.6, 4, 3, 4};
  for (const Vec3f& normal : {Vec3f{0, 0, 0}, Vec3f{0, 0, 1}, Vec3f{kNan, 0, -1}}) {
    view.normal = NormalMap(9, 7, normal);
    const FusionContexts contexts({view.View(), view.View()}, {{1}, {}}, {});
    EXPECT_EQ(DepthAtPlace(contexts[0].sources[0], place, 4), 4);
  }
}

}  // namespace
}  // namespace acmp
