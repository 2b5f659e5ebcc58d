#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "fusion/analytic_views.h"
#include "fusion/engine_views.h"
#include "fusion/fusion_contexts.h"
#include "fusion/reference_fusion.h"

namespace acmp {
namespace {

double ConfidenceFor(float cost, const ViewEvidence& evidence, double unevenness) {
  return ConfidenceOfError(ExpectedRelativeError(cost, evidence, unevenness));
}

TEST(ConfidenceOfError, HasTheDocumentedValues) {
  // 1 / (1 + 50 (u + 0.01)^0.9 exp(2 k / n - 0.9 a / n - 0.3 P)), worked out by hand to five digits.
  EXPECT_NEAR(ConfidenceFor(2, {}, 0), 0.55790, 1e-5);  // P = exp(-4 / 0.18) = 2e-10
  EXPECT_NEAR(ConfidenceFor(0, {}, 0), 0.63010, 1e-5);
  EXPECT_NEAR(ConfidenceFor(0, {4, 2, 0}, 0), 0.72763, 1e-5);
  EXPECT_NEAR(ConfidenceFor(0, {4, 2, 1}, 0), 0.61837, 1e-5);
  EXPECT_NEAR(ConfidenceFor(0.3f, {4, 2, 0}, 0.09), 0.23010, 1e-5);  // P = exp(-0.5)
}

TEST(ConfidenceOfError, StaysInBoundsAndNeverGoesTheWrongWay) {
  for (int views = 1; views <= 32; views += 3) {
    for (int k = 0; k <= 8; ++k) {
      for (int cost = 0; cost <= 20; ++cost) {
        const double agreement = views * k / 8.0, unevenness = 0.1 * k / 8;
        const int contradicting = views * k / 8;
        const auto confidence = [&](double more_cost, double more_agreement, int more_contradicting,
                                    double more_uneven) {
          return ConfidenceFor(static_cast<float>(0.1 * cost + more_cost),
                               {views, agreement + more_agreement, contradicting + more_contradicting},
                               unevenness + more_uneven);
        };
        const double here = confidence(0, 0, 0, 0);
        ASSERT_GT(here, 0);
        ASSERT_LT(here, 1);
        ASSERT_LE(confidence(0.1, 0, 0, 0), here);
        ASSERT_GT(confidence(0, 0.1, 0, 0), here);
        ASSERT_LT(confidence(0, 0, 1, 0), here);
        ASSERT_LT(confidence(0, 0, 0, 0.01), here);
      }
    }
  }
  EXPECT_GT(ConfidenceFor(0.1f, {}, 0), ConfidenceFor(0.2f, {}, 0));
}

TEST(ConfidenceOfError, IsFiniteForOddInput) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  // The worst cost has a photometric likelihood of exp(-22).
  EXPECT_NEAR(ConfidenceFor(nan, {}, 0.1), ConfidenceFor(kWorstCost, {}, 0.1), 1e-9);
  EXPECT_GT(ConfidenceFor(infinity, {}, 0.1), 0) << "unsupported";
  EXPECT_EQ(ConfidenceFor(-0.5f, {}, 0.1), ConfidenceFor(0, {}, 0.1));
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

double ConfidenceOf(const TestView& reference, const std::vector<float>& source_depths) {
  const std::vector<TestView> sources = SideViews(source_depths);
  return FilterByConsistency(reference.View(), ViewsOf(sources), {}).confidence(kCol, kRow);
}

TEST(FilterByConsistency, ConfidenceCountsWhoSeesThePixel) {
  const TestView wall = FlatView(61, 41, 4);
  // Two of two views agree, two of three (one sees an occluder), and one of them violates the point.
  const double all = ConfidenceOf(wall, {4, 4}), occluded = ConfidenceOf(wall, {4, 4, 3});
  const double contradicted = ConfidenceOf(wall, {4, 4, 5});
  EXPECT_NEAR(all, ConfidenceFor(0, {2, 2, 0}, 0), 1e-7);  // float
  EXPECT_NEAR(occluded, ConfidenceFor(0, {3, 2, 0}, 0), 1e-7);
  EXPECT_NEAR(contradicted, ConfidenceFor(0, {3, 2, 1}, 0), 1e-7);
  // Which views take part in the average does not matter, nor do views without an estimate of their own.
  EXPECT_NEAR(ConfidenceOf(wall, {4, 4, 0}), occluded, 1e-7);
}

TEST(FilterByConsistency, GuessesHaveConfidence) {
  TestView wall = FlatView(61, 41, 4);
  for (float& cost : wall.cost) cost = kWorstCost;
  EXPECT_NEAR(ConfidenceOf(wall, {}), ConfidenceFor(kWorstCost, {}, 0), 1e-7);
  EXPECT_GT(ConfidenceOf(wall, {4}), ConfidenceOf(wall, {}));
  EXPECT_LT(ConfidenceOf(wall, {5}), ConfidenceOf(wall, {}));
}

TEST(FilterByConsistency, ConfidenceIsThatOfTheSurfaceAround) {
  // Without views and unevenness only the cost tells: exp(0.3) between 0 and the worst.
  const auto expected = [](double share_of_worst) {
    return ConfidenceOfError(ExpectedRelativeError(0, {}, 0) * std::exp(0.3 * share_of_worst));
  };
  TestView wall = FlatView(61, 41, 4);
  wall.cost(kCol, kRow) = kWorstCost;
  EXPECT_NEAR(ConfidenceOf(wall, {}), expected(1 / 25.0), 1e-7);
  wall.cost(kCol + 16, kRow) = wall.cost(kCol - 3, kRow + 3) = wall.cost(kCol, kRow - 8) = kWorstCost;
  wall.cost(kCol + 1, kRow) = kWorstCost;  // not looked at
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
  // Half of what is around lies 20 % nearer, all of it guesses: it makes the pixel uneven, but its costs do not matter.
  const auto confidence = [](float cost_of_nearer) {
    TestView view = FlatView(61, 41, 4);
    for (int row = 0; row < 41; ++row) {
      for (int col = kCol + 1; col < 61; ++col) {
        view.depth(col, row) = 3.2f;
        view.cost(col, row) = cost_of_nearer;
      }
    }
    return ConfidenceOf(view, {});
  };
  EXPECT_EQ(confidence(0), confidence(kWorstCost));
  EXPECT_LT(confidence(0), ConfidenceOf(FlatView(61, 41, 4), {}));
}

TEST(FilterByConsistency, UnsupportedPixelsAreGuessesOfFourTimesTheError) {
  TestView wall = FlatView(61, 41, 4);
  for (float& cost : wall.cost) cost = kWorstCost;
  const double guess = ConfidenceOf(wall, {4, 4});
  for (float& cost : wall.cost) cost = kUnsupportedCost;
  const double unsupported = ConfidenceOf(wall, {4, 4});
  EXPECT_NEAR((1 - unsupported) / unsupported, 4 * (1 - guess) / guess,
              0.02 * (1 - unsupported) / unsupported);  // exp(1.4) = 4.06
  for (float& cost : wall.cost) cost = 0.1f;
  wall.cost(kCol, kRow) = kUnsupportedCost;
  const std::vector<TestView> sources = SideViews({4, 4});
  const auto count = [&] { return FilterByConsistency(wall.View(), ViewsOf(sources), {}).points_in_camera.size(); };
  const size_t without_it = count();
  wall.cost(kCol, kRow) = 0.1f;
  EXPECT_EQ(count(), without_it + 1);
}

}  // namespace
}  // namespace acmp
