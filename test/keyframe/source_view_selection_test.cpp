#include "acmp_mapping/keyframe/source_view_selection.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "keyframe/small_camera.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kPi = 3.14159265358979323846;
constexpr double kRadius = 4;  // of the arc on which cameras stand, m: the depth of what they look at

/// A camera on the circle of radius `radius` around a target, off the -z direction by `angle_deg` to the side (about y)
/// and `up_deg` upwards, and looking at it.
PosedCamera OnArc(double angle_deg, double radius = kRadius, const PinholeCamera& camera = kSmallCamera,
                  double up_deg = 0) {
  const RigidTransform world_from_cam =
      Eigen::Translation3d(1, 2, 3) * Eigen::AngleAxisd(angle_deg * kPi / 180, Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(up_deg * kPi / 180, Eigen::Vector3d::UnitX()) * Eigen::Translation3d(0, 0, -radius);
  return {camera, world_from_cam.inverse()};
}

PosedCamera Turned(PosedCamera view, double angle_deg) {
  view.cam_from_world = Eigen::AngleAxisd(angle_deg * kPi / 180, Eigen::Vector3d::UnitY()) * view.cam_from_world;
  return view;
}

SourceViewSelection Select(const std::vector<PosedCamera>& views, int max_source_views = 10,
                           const PosedCamera& reference = OnArc(0), double depth = kRadius) {
  std::vector<SourceViewCandidate> candidates;
  candidates.reserve(views.size());
  for (const PosedCamera& view : views) candidates.push_back({view});
  return SelectSourceViews(reference, depth, candidates, max_source_views);
}

std::vector<size_t> Indices(const SourceViewSelection& selection) {
  std::vector<size_t> indices;
  indices.reserve(selection.views.size());
  for (const SelectedSourceView& view : selection.views) indices.push_back(view.index);
  return indices;
}

/// Of the view alone.
double GainOf(const PosedCamera& view) {
  const SourceViewSelection selection = Select({view});
  return selection.views.empty() ? 0 : selection.views[0].gain;
}

TEST(SelectSourceViewsTest, PrefersGoodTriangulationAngles) {
  EXPECT_EQ(GainOf(OnArc(7)), 1);  // all in view, all within the best angles
  EXPECT_GT(GainOf(OnArc(7)), GainOf(OnArc(2.5)));
  EXPECT_GT(GainOf(OnArc(7)), GainOf(OnArc(20)));
  EXPECT_GT(GainOf(OnArc(20)), GainOf(OnArc(35)));
  // At 3 degrees the ramp from 1 to 5 gives about (3 - 1) / 4, a little less towards the corners, which are farther.
  EXPECT_NEAR(GainOf(OnArc(3)), 0.45, 0.05);
}

TEST(SelectSourceViewsTest, TakesTheOtherSideBeforeMoreFromTheSame) {
  // Three to the right at better angles than the one to the left: the left one is the second.
  EXPECT_THAT(Indices(Select({OnArc(7), OnArc(8), OnArc(9), OnArc(-4.5)}, 2)), ElementsAre(0, 3));
  // Above is neither right nor left.
  EXPECT_THAT(Indices(Select({OnArc(7), OnArc(8), OnArc(0, kRadius, kSmallCamera, 4.5)}, 2)), ElementsAre(0, 2));
}

TEST(SelectSourceViewsTest, SecondViewFromTheSameSideCountsHalf) {
  const double alone = GainOf(OnArc(7));
  const SourceViewSelection same_side = Select({OnArc(7), OnArc(7.001)});
  ASSERT_EQ(same_side.views.size(), 2u);
  // Where the first has weight 1 the second counts 1 / (1 + 1).
  EXPECT_NEAR(same_side.views[1].gain, 0.5 * alone, 0.01);
  const SourceViewSelection other_side = Select({OnArc(7), OnArc(-7)});
  EXPECT_NEAR(other_side.views[1].gain, alone, 1e-9);
  EXPECT_EQ(other_side.gain, other_side.views[0].gain + other_side.views[1].gain);
}

TEST(SelectSourceViewsTest, FillsThePartOfTheReferenceThatNoViewSeesYet) {
  // Two see the left half, the third, a little worse, the right half.
  const PosedCamera left = Turned(OnArc(7), 30), right = Turned(OnArc(4.5), -30);
  EXPECT_THAT(Indices(Select({left, left, right})), ElementsAre(0, 2, 1));
}

TEST(SelectSourceViewsTest, PenalisesAnotherResolution) {
  const double same = GainOf(OnArc(10));
  EXPECT_NEAR(GainOf(OnArc(10, 1.2 * kRadius)), same, 0.1 * same);
  // Twice the distance and half the focal length are the same loss of resolution; what is in view differs.
  EXPECT_NEAR(GainOf(OnArc(10, kRadius, kSmallCamera.Resized(50, 40))), same * 0.75 * 0.75, 0.1 * same);
  EXPECT_NEAR(GainOf(OnArc(10, 2 * kRadius)), same * 0.75 * 0.75, 0.15 * same);
  EXPECT_LT(GainOf(OnArc(10, 4 * kRadius)), 0.2 * same);
}

TEST(SelectSourceViewsTest, TakesViewsOfAHigherPriorityFirst) {
  std::vector<SourceViewCandidate> candidates = {{OnArc(7)}, {OnArc(2), 1}, {OnArc(-7)}, {OnArc(2.5), 1}};
  const SourceViewSelection all = SelectSourceViews(OnArc(0), kRadius, candidates, 10);
  EXPECT_THAT(Indices(all), ElementsAre(3, 1, 2, 0));
  EXPECT_EQ(all.num_useful, 4);
  EXPECT_THAT(Indices(SelectSourceViews(OnArc(0), kRadius, candidates, 3)), ElementsAre(3, 1, 2));
}

TEST(SelectSourceViewsTest, TakesViewsAheadThatSeeOnlyTheBorderAtAnAngle) {
  const auto ahead = [](double z) {
    PosedCamera view = {kSmallCamera};
    view.cam_from_world.translation().z() = -z;
    return view;
  };
  // Moving towards a wall 20 m away: after 1 m the middle of the picture is seen under no angle, the corners under 1.8
  // degrees; after 0.1 m nothing is.
  const SourceViewSelection selection = Select({ahead(0.1), ahead(1)}, 10, ahead(0), 20);
  EXPECT_THAT(Indices(selection), ElementsAre(1));
  EXPECT_EQ(selection.num_with_small_angle, 1);
}

TEST(SelectSourceViewsTest, LeavesOutViewsWithoutBaselineOrOverlap) {
  EXPECT_THAT(Indices(Select({OnArc(0), Turned(OnArc(0), 3)})), IsEmpty());
  PosedCamera elsewhere = OnArc(10);
  elsewhere.cam_from_world.translation().x() += 20;
  EXPECT_THAT(Indices(Select({Turned(OnArc(10), 180), elsewhere})), IsEmpty());
  EXPECT_THAT(Indices(Select({})), IsEmpty());
}

TEST(SelectSourceViewsTest, TellsWhyCandidatesAreNotUseful) {
  PosedCamera elsewhere = OnArc(10);
  elsewhere.cam_from_world.translation().x() += 20;
  const SourceViewSelection selection =
      Select({OnArc(0), OnArc(0.5), OnArc(0.8), elsewhere, OnArc(0.4), OnArc(8), OnArc(-8), OnArc(0)}, 1);
  EXPECT_EQ(selection.num_without_baseline, 2);
  EXPECT_EQ(selection.num_with_small_angle, 3);
  EXPECT_EQ(selection.num_without_overlap, 1);
  EXPECT_EQ(selection.num_useful, 2);  // one more than asked for
  EXPECT_EQ(selection.views.size(), 1u);
  // 0.8 degrees at the image's centre and less towards the corners, which are farther.
  EXPECT_NEAR(selection.largest_small_angle_deg, 0.8, 0.1);
}

TEST(SelectSourceViewsTest, KeepsTheBestAndBreaksTiesByIndex) {
  std::vector<PosedCamera> views(40, OnArc(10));
  views.push_back(OnArc(2));
  EXPECT_THAT(Indices(Select(views, 3)), ElementsAre(0, 1, 2));
  EXPECT_EQ(Select(views, 32).views.size(), 32u);
}

TEST(SelectSourceViewsTest, DependsOnAnglesAndNotOnTheScenesUnit) {
  const std::vector<PosedCamera> views = {OnArc(2), OnArc(10), OnArc(-35), OnArc(20)};
  const SourceViewSelection expected = Select(views);
  ASSERT_EQ(expected.views.size(), 4u);
  for (const double scale : {1e-4, 1e4}) {
    const auto scaled = [&](PosedCamera view) {
      view.cam_from_world.translation() *= scale;
      return view;
    };
    std::vector<PosedCamera> scaled_views;
    scaled_views.reserve(views.size());
    for (const PosedCamera& view : views) scaled_views.push_back(scaled(view));
    const SourceViewSelection selection = Select(scaled_views, 10, scaled(OnArc(0)), scale * kRadius);
    ASSERT_EQ(Indices(selection), Indices(expected));
    // Rounding of double at the same relative size.
    for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(selection.views[i].gain, expected.views[i].gain, 1e-9);
  }
  // The scene twice as far: the angles halve.
  EXPECT_NEAR(Select({OnArc(1.6)}, 10, OnArc(0), 2 * kRadius).largest_small_angle_deg, 0.8, 0.1);
}

}  // namespace
}  // namespace acmp
