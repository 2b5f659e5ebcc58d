#include <cmath>
#include <limits>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/keyframe/source_view_selection.h"
#include "support/error_text.h"

namespace acmp {
namespace {

const PinholeCamera kSmallCamera = {100, 80, 90, 90, 49.5, 39.5};

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// 101 points on the optical axis at depths 1.00, 1.01, ..., 2.00 of a camera that looks along world x.
struct AxisScene {
  AxisScene() {
    Eigen::Matrix3d cam_from_world;
    cam_from_world << 0, -1, 0, 0, 0, -1, 1, 0, 0;  // x right = -y, y down = -z, z forward = x
    pose.linear() = cam_from_world;
    pose.translation() = -cam_from_world * Eigen::Vector3d(5, 6, 7);
    for (int i = 100; i >= 0; --i) points.push_back(AtDepth(1.0 + 0.01 * i));
  }
  Eigen::Vector3d AtDepth(double depth) const { return {5 + depth, 6, 7}; }

  RigidTransform pose = RigidTransform::Identity();
  std::vector<Eigen::Vector3d> points;
};

TEST(DepthRangeTest, TakesQuantilesWithMargin) {
  const AxisScene scene;
  const auto range = DepthRangeFromLandmarks(scene.points, kSmallCamera, scene.pose);
  ASSERT_TRUE(range);
  // Of 101 sorted depths 2 % lie below 1.02 and above 1.98; the result is a float.
  EXPECT_NEAR(range->min, 1.02 / kDepthMargin, 1e-6);
  EXPECT_NEAR(range->max, 1.98 * kDepthMargin, 1e-6);
}

TEST(DepthRangeTest, IgnoresWhatIsNotALandmarkInView) {
  AxisScene scene;
  const auto expected = DepthRangeFromLandmarks(scene.points, kSmallCamera, scene.pose);
  // (0, 0, 0) is in front of this camera, so only the rule about exact zeros keeps it out.
  scene.pose.translation() += Eigen::Vector3d(0, 0, 100);
  for (auto& point : scene.points) point.x() -= 100;
  for (int i = 0; i < 200; ++i) {
    scene.points.insert(scene.points.end(), {{kNan, 1, 1},
                                             {1, kInf, 1},
                                             {1, 1, -kInf},
                                             {0, 0, 0},
                                             scene.AtDepth(-100.0 - i),  // the camera's centre: z = -i
                                             {scene.points[0].x(), 6 + 0.02 * i + 2, 7},
                                             {scene.points[0].x(), 6, 7 - 0.02 * i - 2}});
  }
  const auto range = DepthRangeFromLandmarks(scene.points, kSmallCamera, scene.pose);
  ASSERT_TRUE(range);
  EXPECT_FLOAT_EQ(range->min, expected->min);
  EXPECT_FLOAT_EQ(range->max, expected->max);
}

TEST(DepthRangeTest, NoneWithTooFewLandmarks) {
  const AxisScene scene;
  EXPECT_FALSE(DepthRangeFromLandmarks({}, kSmallCamera, scene.pose));
  const std::vector<Eigen::Vector3d> nine(scene.points.begin(), scene.points.begin() + 9);
  EXPECT_FALSE(DepthRangeFromLandmarks(nine, kSmallCamera, scene.pose));
  const std::vector<Eigen::Vector3d> ten(scene.points.begin(), scene.points.begin() + 10);
  EXPECT_TRUE(DepthRangeFromLandmarks(ten, kSmallCamera, scene.pose));
}

const PinholeCamera kCamera = {6, 4, 5.0, 5.5, 2.5, 1.5};

ColorImage MakeColor(int width, int height) {
  ColorImage color(width, height);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      color(col, row) = {static_cast<unsigned char>(10 * col), static_cast<unsigned char>(20 * row),
                         static_cast<unsigned char>(3 * col + 7 * row)};
    }
  }
  return color;
}

double Gray(const Rgb& c) { return 0.299 * c.r + 0.587 * c.g + 0.114 * c.b; }

TEST(MakeFrameTest, AveragesGrayInFloatWhenShrinking) {
  const ColorImage color = MakeColor(6, 4);
  const Frame frame = MakeFrame(0, 0, color.Clone(), kCamera, RigidTransform::Identity(), {}, {3});
  ASSERT_EQ(frame.gray.width(), 3);
  ASSERT_EQ(frame.gray.height(), 2);
  ASSERT_EQ(frame.color.width(), 3);
  for (int row = 0; row < 2; ++row) {
    for (int col = 0; col < 3; ++col) {
      const double mean = (Gray(color(2 * col, 2 * row)) + Gray(color(2 * col + 1, 2 * row)) +
                           Gray(color(2 * col, 2 * row + 1)) + Gray(color(2 * col + 1, 2 * row + 1))) /
                          4;
      // Below the 0.5 that rounding to 8 bits in between would cost.
      EXPECT_NEAR(frame.gray(col, row), mean, 1e-3);
    }
  }
  EXPECT_DOUBLE_EQ(frame.camera.fx, 2.5);
  EXPECT_DOUBLE_EQ(frame.camera.cx, (2.5 + 0.5) * 0.5 - 0.5);
}

TEST(MakeFrameTest, PriorDepthOfAnySizeTakesTheFramesSizeWithoutInterpolation) {
  DepthMap depth(3, 2);
  const float values[] = {1, 2, -1, 4, NAN, INFINITY};
  std::copy(std::begin(values), std::end(values), depth.begin());
  const auto make = [&](int max_size, const DepthMap& of_image) {
    return MakeFrame(0, 0, MakeColor(6, 4), kCamera, RigidTransform::Identity(), {}, {max_size}, {}, of_image);
  };
  const Frame enlarged = make(0, depth);
  ASSERT_EQ(enlarged.prior_depth.width(), 6);
  ASSERT_EQ(enlarged.prior_depth.height(), 4);
  const std::vector<float> rows[] = {{1, 1, 2, 2, 0, 0}, {4, 4, 0, 0, 0, 0}};
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 6; ++col)
      EXPECT_EQ(enlarged.prior_depth(col, row), rows[row / 2][col]) << col << " " << row;
  }
  const Frame same = make(3, depth);
  EXPECT_EQ(same.prior_depth(1, 0), 2);
  EXPECT_EQ(same.prior_depth(1, 1), 0) << "not a number: unknown";
  EXPECT_TRUE(make(3, {}).prior_depth.empty());
}

TEST(MakeFrameTest, MaskIsResizedWithTheImageAndLandmarksOnItAreLeftOut) {
  Mask mask(6, 4, 200);
  mask(2, 1) = 0;
  const auto at = [](double col, double row) -> Eigen::Vector3d { return 2.0 * kCamera.Unproject({col, row}); };
  const std::vector<Eigen::Vector3d> landmarks = {at(2, 1), at(4, 1), {0, 0, -1}};
  const auto make = [&](int max_size, const Mask& of_image) {
    return MakeFrame(0, 0, MakeColor(6, 4), kCamera, RigidTransform::Identity(), landmarks, {max_size}, of_image);
  };
  const Frame frame = make(0, mask);
  ASSERT_EQ(frame.mask.width(), 6);
  EXPECT_EQ(frame.mask(2, 1), 0);
  EXPECT_NE(frame.mask(1, 1), 0);
  ASSERT_EQ(frame.landmarks_in_world.size(), 2u);  // behind the camera: not seen, whatever the mask
  EXPECT_EQ(frame.landmarks_in_world[0], landmarks[1]);

  const Frame shrunk = make(3, mask);
  ASSERT_EQ(shrunk.mask.width(), 3);
  EXPECT_EQ(shrunk.mask(1, 0), 0);
  EXPECT_NE(shrunk.mask(0, 0), 0);
  EXPECT_EQ(shrunk.landmarks_in_world.size(), 2u);

  const Frame whole = make(0, Mask(6, 4, 1));
  EXPECT_TRUE(whole.mask.empty()) << "ignores nothing";
  EXPECT_EQ(whole.landmarks_in_world.size(), 3u);
  EXPECT_REFUSED(make(0, Mask(4, 6, 255)), "mask size 4 x 6", "6 x 4");
}

// At every count: a vectorised loop and its remainder are compiled differently.
TEST(RoundedToFloatTest, EveryCoordinateIsAFloat) {
  for (size_t count = 0; count < 20; ++count) {
    std::vector<Eigen::Vector3d> points;
    for (size_t i = 0; i < count; ++i) points.emplace_back(0.1 * static_cast<double>(i + 1), 0.2, -1e-9);
    const std::vector<Eigen::Vector3d> rounded = RoundedToFloat(points);
    ASSERT_EQ(rounded.size(), count);
    for (size_t i = 0; i < count; ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        volatile float expected = static_cast<float>(points[i][axis]);  // volatile: not subject to what is tested
        EXPECT_EQ(rounded[i][axis], static_cast<double>(expected)) << count << " points, " << i << ", axis " << axis;
      }
    }
  }
}

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

/// A range with this depth in the middle.
DepthRange About(double depth) { return {static_cast<float>(depth / 2), static_cast<float>(depth * 2)}; }

SourceViewSelection Select(const std::vector<PosedCamera>& views, int max_source_views = 10,
                           const PosedCamera& reference = OnArc(0), double depth = kRadius) {
  std::vector<SourceViewCandidate> candidates;
  candidates.reserve(views.size());
  for (const PosedCamera& view : views) candidates.push_back({view});
  return SelectSourceViews(reference, About(depth), candidates, max_source_views);
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

TEST(SelectSourceViewsTest, AnotherLengthOfTheBaselineCountsLikeAnotherSide) {
  const double alone = GainOf(OnArc(5.5));
  EXPECT_NEAR(Select({OnArc(9.5), OnArc(9.501)}).views[1].gain, 0.5 * GainOf(OnArc(9.5)), 0.01);
  // Along nearly one direction the first counts for as much as it is longer or shorter: 5.5 / 9.5.
  EXPECT_NEAR(Select({OnArc(9.5), OnArc(5.5)}).gain - GainOf(OnArc(9.5)), alone / (1 + 5.5 / 9.5), 0.03);
}

TEST(SelectSourceViewsTest, FindsShortBaselinesForWhatIsNearAndLongOnesForWhatIsFar) {
  const auto beside = [](double x) {
    PosedCamera view = {kSmallCamera};
    view.cam_from_world.translation().x() = -x;
    return view;
  };
  const std::vector<PosedCamera> views = {beside(3.5), beside(4), beside(4.5), beside(0.7), beside(-0.7), beside(-3.5)};
  std::vector<SourceViewCandidate> candidates;
  for (const PosedCamera& view : views) candidates.push_back({view});
  const auto choose = [&](const DepthRange& range) {
    return Indices(SelectSourceViews(beside(0), range, candidates, 3));
  };
  // At 30 m the short ones are of no use. Depths of 2 to 450 m are two planes, about 8 and 116 m.
  EXPECT_THAT(choose({15, 60}), Not(AnyOf(Contains(3), Contains(4))));
  EXPECT_THAT(choose({2, 450}), AnyOf(Contains(3), Contains(4)));
}

TEST(SelectSourceViewsTest, LeavesOutViewsThatHardlyShareLandmarksWhereFourOthersDo) {
  std::vector<SourceViewCandidate> candidates = {
      {OnArc(7), 0, 0.02}, {OnArc(-7), 0, 0.5}, {OnArc(4), 0, 0.06}, {OnArc(-4), 0, 0.3}};
  const auto choose = [&] { return Indices(SelectSourceViews(OnArc(0), About(kRadius), candidates, 10)); };
  EXPECT_THAT(choose(), UnorderedElementsAre(0, 1, 2, 3));
  candidates.push_back({OnArc(12)});  // nobody knows what it shares
  EXPECT_THAT(choose(), UnorderedElementsAre(1, 2, 3, 4));
}

TEST(SelectSourceViewsTest, RefusesBadRanges) {
  EXPECT_REFUSED(SelectSourceViews(OnArc(0), DepthRange{0, 5}, {}, 10), "depth range [0, 5]");
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
  const SourceViewSelection all = SelectSourceViews(OnArc(0), About(kRadius), candidates, 10);
  EXPECT_THAT(Indices(all), ElementsAre(3, 1, 2, 0));
  EXPECT_EQ(all.num_useful, 4);
  EXPECT_THAT(Indices(SelectSourceViews(OnArc(0), About(kRadius), candidates, 3)), ElementsAre(3, 1, 2));
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

TEST(SelectSourceViewsTest, AViewThatSeesATenthAtAnySideOverlaps) {
  const PosedCamera reference = OnArc(0);
  for (const Eigen::Vector3d& axis :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(-1, 0, 0), Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, -1, 0)}) {
    for (int angle_deg = 0; angle_deg < 90; ++angle_deg) {
      PosedCamera view = OnArc(7);
      view.cam_from_world = Eigen::AngleAxisd(angle_deg * kPi / 180, axis) * view.cam_from_world;
      int seen = 0;  // of 8 x 8 points
      for (int i = 0; i < 64; ++i) {
        const PinholeCamera& camera = reference.camera;
        const Eigen::Vector2d pixel((i % 8 + 0.5) / 8 * camera.width - 0.5, (i / 8 + 0.5) / 8 * camera.height - 0.5);
        const Eigen::Vector3d point = reference.cam_from_world.inverse() * camera.Unproject(pixel, kRadius);
        seen += view.camera.PixelOf(view.cam_from_world * point).has_value();
      }
      EXPECT_EQ(Select({view}).num_without_overlap, seen < 6.4 ? 1 : 0) << seen << " seen, turned by " << angle_deg;
    }
  }
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
    // The range is of floats, 6e-8 of a depth; gains change by less than ten times the share by which a depth does.
    for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(selection.views[i].gain, expected.views[i].gain, 6e-7);
  }
  // The scene twice as far: the angles halve.
  EXPECT_NEAR(Select({OnArc(1.6)}, 10, OnArc(0), 2 * kRadius).largest_small_angle_deg, 0.8, 0.1);
}

}  // namespace
}  // namespace acmp
