#include <gtest/gtest.h>

#include <limits>

#include "fusion/analytic_views.h"
#include "fusion/fusion_contexts.h"

namespace acmp {
namespace {

// Threshold tests use two cameras and a pixel whose errors are known exactly.

/// Number of consistent views of the middle pixel of a 41 x 1 image.
int ConsistentViews(const TestView& reference, const TestView& source, const FusionOptions& options = PaperFusion()) {
  return CountMatches(reference.View(), {source.View()}, options)(20, 0);
}

TEST(FilterByConsistency, ComparesDepthsRelativeToTheReference) {
  // Without a baseline the source depth is compared as it is, and the reprojection error is 0.
  const auto count = [](float relative, float limit) {
    FusionOptions options = PaperFusion();
    options.max_relative_depth = limit;
    return ConsistentViews(FlatView(41, 1, 4), FlatView(41, 1, 4 * (1 + relative)), options);
  };
  EXPECT_EQ(count(0.0099f, 0.01f), 1);
  EXPECT_EQ(count(0.0101f, 0.01f), 0);
  EXPECT_EQ(count(-0.0099f, 0.01f), 1);
  EXPECT_EQ(count(-0.0101f, 0.01f), 0);
  EXPECT_EQ(count(0.0101f, 0.0102f), 1);
}

TEST(FilterByConsistency, ComparesNormalsInACommonFrame) {
  const auto count = [](double angle_deg, float limit_deg, double camera_turn_deg) {
    TestView reference = FlatView(41, 1, 4), source = FlatView(41, 1, 4);
    // Both cameras stand at one place, the source rolled about its axis: the normal is given in its own frame.
    source.cam_from_world.linear() =
        Eigen::AngleAxisd(camera_turn_deg * M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    const auto tilted = [](double tilt_deg, double roll_deg) {
      const Eigen::Vector3d n = Eigen::AngleAxisd(roll_deg * M_PI / 180, Eigen::Vector3d::UnitZ()) *
                                Eigen::Vector3d(std::sin(tilt_deg * M_PI / 180), 0, -std::cos(tilt_deg * M_PI / 180));
      return Vec3f{static_cast<float>(n.x()), static_cast<float>(n.y()), static_cast<float>(n.z())};
    };
    reference.normal = NormalMap(41, 1, tilted(30, 0));
    source.normal = NormalMap(41, 1, tilted(30 + angle_deg, camera_turn_deg));
    FusionOptions options = PaperFusion();
    options.max_normal_angle_deg = limit_deg;
    return ConsistentViews(reference, source, options);
  };
  for (const double turn_deg : {0.0, 180.0}) {
    EXPECT_EQ(count(9.99, 10, turn_deg), 1);
    EXPECT_EQ(count(10.01, 10, turn_deg), 0);
    EXPECT_EQ(count(-9.99, 10, turn_deg), 1);
    EXPECT_EQ(count(-10.01, 10, turn_deg), 0);
    EXPECT_EQ(count(10.01, 10.02f, turn_deg), 1);
  }
}

TEST(FilterByConsistency, BoundsTheForwardBackwardError) {
  // f = 100, baseline 0.4, depth 4: the point moves by exactly 10 px; with depth 4 / (1 + e) there, it comes back 10 e
  // off.
  const auto count = [](double error_px, float limit_px) {
    TestView source = FlatView(41, 1, static_cast<float>(4 / (1 + error_px / 10)));
    source.cam_from_world.translation().x() = -0.4;
    FusionOptions options = PaperFusion();
    options.max_reprojection_px = limit_px;
    options.max_relative_depth = 0.5f;
    return ConsistentViews(FlatView(41, 1, 4), source, options);
  };
  EXPECT_EQ(count(1.99, 2), 1);
  EXPECT_EQ(count(2.01, 2), 0);
  EXPECT_EQ(count(-1.99, 2), 1);
  EXPECT_EQ(count(-2.01, 2), 0);
  EXPECT_EQ(count(2.01, 2.02f), 1);
}

TEST(FilterByConsistency, DoesNotMatchPointsBehindTheSource) {
  // The point lies 0.3 behind the source, which sees a surface 0.3 in front of it, on the same ray and 0.6 % deeper.
  TestView source = FlatView(41, 1, 0.3f);
  source.cam_from_world.translation().z() = -100.3;
  EXPECT_EQ(ConsistentViews(FlatView(41, 1, 100), source), 0);
  source.cam_from_world.translation().z() = -99.7;  // now in front of it
  EXPECT_EQ(ConsistentViews(FlatView(41, 1, 100), source), 1);
}

TEST(FilterByConsistency, DoesNotMatchPointsBehindTheReference) {
  // The source, 200 ahead, looks back over the reference's head: its surface lies 100 behind the reference.
  TestView source = FlatView(41, 1, 300);
  source.cam_from_world = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()) * Eigen::Translation3d(0, 0, -200);
  source.normal = NormalMap(41, 1, {0, 0, 1});  // as the reference's, to leave the decision to the depths
  FusionOptions options = PaperFusion();
  options.max_relative_depth = 0.999f;
  EXPECT_EQ(ConsistentViews(FlatView(41, 1, 100), source, options), 0);
  source.depth = DepthMap(41, 1, 100);
  EXPECT_EQ(ConsistentViews(FlatView(41, 1, 100), source, options), 1);
}

TEST(FilterByConsistency, UnknownNormalsAgreeWithNothing) {
  for (const Vec3f& unknown : {Vec3f{0, 0, 0}, Vec3f{kNan, 0, 1}}) {
    TestView without = FlatView(41, 1, 4);
    without.normal = NormalMap(41, 1, unknown);
    FusionOptions options = PaperFusion();
    options.max_normal_angle_deg = 180;
    EXPECT_EQ(ConsistentViews(FlatView(41, 1, 4), without, options), 0);
    EXPECT_EQ(ConsistentViews(without, FlatView(41, 1, 4), options), 0);
  }
}

TEST(FilterByConsistency, NeedsMinConsistentViews) {
  const TestView view = FlatView(5, 4, 3), other = FlatView(5, 4, 9);
  for (int required = 1; required <= 4; ++required) {
    const auto result =
        FilterByConsistency(view.View(), {view.View(), other.View(), view.View(), view.View()}, PaperFusion(required));
    EXPECT_EQ(result.points_in_camera.size(), required <= 3 ? 20u : 0u);
  }
}

}  // namespace
}  // namespace acmp
