#include "acmp_mapping/keyframe/source_view_selector.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kPi = 3.14159265358979323846;
const PinholeCamera kCamera = {100, 80, 90, 90, 49.5, 39.5};

std::vector<size_t> Indices(const std::vector<RankedSourceView>& ranked) {
  std::vector<size_t> indices;
  indices.reserve(ranked.size());
  for (const RankedSourceView& view : ranked) indices.push_back(view.index);
  return indices;
}

/// A camera on the circle of radius `radius` around `target`, `angle_deg` off the -z direction and looking at it.
Frame FrameOnArc(double angle_deg, double radius = 4, const PinholeCamera& camera = kCamera,
                 const Eigen::Vector3d& target = {1, 2, 3}) {
  Frame frame;
  frame.camera = camera;
  const RigidTransform world_from_cam = Eigen::Translation3d(target) *
                                        Eigen::AngleAxisd(angle_deg * kPi / 180, Eigen::Vector3d::UnitY()) *
                                        Eigen::Translation3d(0, 0, -radius);
  frame.cam_from_world = world_from_cam.inverse();
  return frame;
}

FramePtr Share(Frame frame) { return std::make_shared<Frame>(std::move(frame)); }

FramePtr WithLandmarks(Frame frame, const std::vector<Eigen::Vector3d>& landmarks) {
  frame.landmarks_in_world = landmarks;
  return Share(std::move(frame));
}

/// Frontal grid of (2 n + 1)^2 points around the arc's target.
std::vector<Eigen::Vector3d> Wall(int n, double half_size = 0.5) {
  std::vector<Eigen::Vector3d> points;
  for (int i = -n; i <= n; ++i) {
    for (int j = -n; j <= n; ++j) points.emplace_back(1 + half_size * i / n, 2 + half_size * j / n, 3);
  }
  return points;
}

std::vector<FrameLandmarksPtr> LandmarksOf(const std::vector<FramePtr>& frames) {
  std::vector<FrameLandmarksPtr> landmarks;
  for (const FramePtr& frame : frames) landmarks.push_back(std::make_shared<FrameLandmarks>(frame));
  return landmarks;
}

SourceViewSelector SelectorFor(const Frame& reference, double fallback_depth, const SourceViewOptions& options) {
  // The reference outlives it: a pointer that does not own.
  return {std::make_shared<FrameLandmarks>(FramePtr(FramePtr(), &reference)), fallback_depth, options};
}

std::vector<RankedSourceView> SelectSourceViews(const Frame& reference, const std::vector<FramePtr>& candidates,
                                                double fallback_depth, const SourceViewOptions& options) {
  return SelectorFor(reference, fallback_depth, options).Select(LandmarksOf(candidates));
}

TEST(SelectSourceViewsTest, RanksByTriangulationAngle) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  const std::vector<FramePtr> candidates = {Share(FrameOnArc(2)), Share(FrameOnArc(-12)), Share(FrameOnArc(35)),
                                            Share(FrameOnArc(60)), Share(FrameOnArc(0.3))};
  const auto ranked = SelectSourceViews(reference, candidates, 0, {});
  EXPECT_THAT(Indices(ranked), ElementsAre(1, 0, 2, 3));
  // The wall's centre is seen under exactly the arc's angle; the median over the wall differs by its extent only.
  EXPECT_NEAR(ranked[0].angle_deg, 12, 0.3);
  EXPECT_NEAR(ranked[1].angle_deg, 2, 0.1);
  EXPECT_NEAR(ranked[2].angle_deg, 35, 1.0);
}

TEST(SelectSourceViewsTest, ScoreIsShareTimesMeanWeight) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  // All seen, all within the best angles, same scale: 1.
  const auto best = SelectSourceViews(reference, {WithLandmarks(FrameOnArc(8), Wall(4))}, 0, {});
  ASSERT_EQ(best.size(), 1u);
  EXPECT_NEAR(best[0].score, 1, 1e-12);
  // At 3 degrees the ramp from 1 to 5 gives about (3 - 1) / 4.
  const auto narrow = SelectSourceViews(reference, {WithLandmarks(FrameOnArc(3), Wall(4))}, 0, {});
  ASSERT_EQ(narrow.size(), 1u);
  EXPECT_NEAR(narrow[0].score, 0.5, 0.02);
}

TEST(SelectSourceViewsTest, MoreSharedLandmarksRankHigher) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4, 1.2);
  // Turned away about its own centre: same baseline and angles, fewer landmarks in view.
  Frame turned = FrameOnArc(-10);
  turned.cam_from_world =
      RigidTransform(Eigen::AngleAxisd(30 * kPi / 180, Eigen::Vector3d::UnitY())) * turned.cam_from_world;
  const std::vector<FramePtr> candidates = {Share(std::move(turned)), Share(FrameOnArc(10))};
  const auto ranked = SelectSourceViews(reference, candidates, 0, {});
  ASSERT_THAT(Indices(ranked), ElementsAre(1, 0));
  EXPECT_LT(ranked[1].score, 0.75 * ranked[0].score);
}

TEST(SelectSourceViewsTest, PenalisesAnotherResolution) {
  Frame reference = FrameOnArc(0, 4);
  reference.landmarks_in_world = Wall(4, 0.2);
  PinholeCamera half = kCamera.Resized(50, 40);
  const std::vector<FramePtr> candidates = {Share(FrameOnArc(10, 16)), Share(FrameOnArc(10, 8)),
                                            Share(FrameOnArc(10, 4.2)), Share(FrameOnArc(10, 4, half)),
                                            Share(FrameOnArc(10, 1.5))};
  const auto ranked = SelectSourceViews(reference, candidates, 0, {});
  ASSERT_EQ(ranked.size(), 5u);
  EXPECT_EQ(ranked[0].index, 2u);
  EXPECT_EQ(ranked[4].index, 0u);
  // Twice the distance and half the focal length are the same loss of resolution.
  const auto score_of = [&](size_t index) {
    for (const auto& view : ranked) {
      if (view.index == index) return view.score;
    }
    return 0.0;
  };
  EXPECT_NEAR(score_of(1), score_of(3), 0.05 * score_of(3));
  EXPECT_LT(score_of(3), 0.7 * score_of(2));
}

/// A street along z: posts 2 m beside the camera's way, 5 and 7 m ahead, and a house 60 m ahead that has eight times as
/// many points.
std::vector<Eigen::Vector3d> PostsAndHouse() {
  std::vector<Eigen::Vector3d> points;
  for (const double side : {-2.0, 2.0}) {
    for (int i = 0; i < 4; ++i) points.emplace_back(side, 0.1 * i, i % 2 == 0 ? 5 : 7);
  }
  for (int i = 0; i < 64; ++i) points.emplace_back(0.5 * (i % 8 - 3.5), 0.5 * (i / 8 - 3.5), 60);
  return points;
}

TEST(SelectSourceViewsTest, TakesViewsAheadThatSeeNearThingsAtAWideAngleAndMostOfTheSceneAtNone) {
  const auto frame_at = [](double z) {
    Frame frame;
    frame.camera = kCamera;
    frame.cam_from_world.translation().z() = -z;
    return frame;
  };
  Frame reference = frame_at(0);
  reference.landmarks_in_world = PostsAndHouse();
  const std::vector<FramePtr> candidates = {Share(frame_at(0.01)), Share(frame_at(1))};
  const auto ranked = SelectSourceViews(reference, candidates, 0, {});
  // One metre ahead the posts are seen under 2 to 5 degrees, the house under less than 0.1.
  EXPECT_THAT(Indices(ranked), ElementsAre(1));
  EXPECT_LT(ranked[0].angle_deg, 0.1);
  // A tenth of all points has to be seen at an angle: the posts are a ninth, without two of them a twelfth.
  reference.landmarks_in_world.erase(reference.landmarks_in_world.begin(), reference.landmarks_in_world.begin() + 2);
  EXPECT_THAT(SelectSourceViews(reference, candidates, 0, {}), IsEmpty());
}

TEST(SelectSourceViewsTest, LeavesOutViewsWithoutBaseline) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  Frame turned = FrameOnArc(0);
  turned.cam_from_world = RigidTransform(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX())) * turned.cam_from_world;
  const std::vector<FramePtr> candidates = {Share(FrameOnArc(0)), Share(std::move(turned))};
  for (const double fallback : {0.0, 4.0}) {
    EXPECT_THAT(SelectSourceViews(reference, candidates, fallback, {}), IsEmpty());
    reference.landmarks_in_world.clear();
    EXPECT_THAT(SelectSourceViews(reference, candidates, fallback, {}), IsEmpty());
    reference.landmarks_in_world = Wall(4);
  }
}

TEST(SelectSourceViewsTest, LeavesOutViewsWithoutOverlap) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  Frame behind = FrameOnArc(180);
  behind.cam_from_world = RigidTransform(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitY())) * behind.cam_from_world;
  const std::vector<FramePtr> candidates = {Share(std::move(behind)), Share(FrameOnArc(10, 4, kCamera, {20, 2, 3}))};
  EXPECT_THAT(SelectSourceViews(reference, candidates, 0, {}), IsEmpty());
  reference.landmarks_in_world.clear();
  EXPECT_THAT(SelectSourceViews(reference, candidates, 4, {}), IsEmpty());
}

TEST(SelectSourceViewsTest, FallbackDepthGivesTheSameRankingAsAWallAtThatDepth) {
  Frame with_landmarks = FrameOnArc(0);
  with_landmarks.landmarks_in_world = Wall(10, 1.7);
  const Frame without = FrameOnArc(0);
  std::vector<FramePtr> candidates;
  for (const double angle : {1.2, 4.0, 9.0, 45.0, 0.2}) {
    candidates.push_back(WithLandmarks(FrameOnArc(angle), with_landmarks.landmarks_in_world));
  }
  const auto expected = SelectSourceViews(with_landmarks, candidates, 0, {});
  const auto ranked = SelectSourceViews(without, candidates, 4, {});
  EXPECT_EQ(Indices(ranked), Indices(expected));
  ASSERT_FALSE(ranked.empty());
  EXPECT_NEAR(ranked[0].angle_deg, expected[0].angle_deg, 0.5);
  EXPECT_NEAR(ranked[0].score, expected[0].score, 0.05);
  // The scene twice as far: the angles halve.
  EXPECT_NEAR(SelectSourceViews(without, candidates, 8, {})[0].angle_deg, expected[0].angle_deg / 2, 1.0);
}

TEST(SelectSourceViewsTest, FewLandmarksGiveTheDepthOnly) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = {{1, 2, 3}};
  const auto ranked = SelectSourceViews(reference, {Share(FrameOnArc(10))}, 0, {});
  ASSERT_EQ(ranked.size(), 1u);
  // 10 degrees at the image's centre and less towards the corners, which are farther; another depth would show as much
  // as its ratio to the true one.
  EXPECT_NEAR(ranked[0].angle_deg, 10, 1.2);
}

TEST(SelectSourceViewsTest, WithoutAnyDepthNearestParallelViewFirst) {
  const Frame reference = FrameOnArc(0);
  const std::vector<FramePtr> candidates = {Share(FrameOnArc(20)), Share(FrameOnArc(5)), Share(FrameOnArc(180)),
                                            Share(FrameOnArc(-10)), Share(FrameOnArc(0))};
  const auto ranked = SelectSourceViews(reference, candidates, 0, {});
  EXPECT_THAT(Indices(ranked), ElementsAre(1, 3, 0));
  for (const auto& view : ranked) {
    EXPECT_GT(view.score, 0);
    EXPECT_EQ(view.angle_deg, 0);
  }
}

TEST(SelectSourceViewsTest, IgnoresLandmarksThatAreNotInView) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  const std::vector<FramePtr> candidates = {Share(FrameOnArc(6)), Share(FrameOnArc(30))};
  const auto expected = SelectSourceViews(reference, candidates, 0, {});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 500; ++i) {
    reference.landmarks_in_world.insert(reference.landmarks_in_world.end(),
                                        {{nan, 0, 0}, {0, 0, 0}, {1, 2, -50.0 - i}, {100.0 + i, 2, 3}});
  }
  const auto ranked = SelectSourceViews(reference, candidates, 0, {});
  ASSERT_EQ(Indices(ranked), Indices(expected));
  for (size_t i = 0; i < ranked.size(); ++i) EXPECT_EQ(ranked[i].score, expected[i].score);
}

TEST(SelectSourceViewsTest, AWholeMapGivesTheSameAsAFewLandmarks) {
  Frame sparse = FrameOnArc(0);
  sparse.landmarks_in_world = Wall(5);
  Frame dense = FrameOnArc(0);
  dense.landmarks_in_world = Wall(60);  // 14641 points over the same wall
  std::vector<FramePtr> candidates;
  for (const double angle : {3.0, 8.0, 30.0}) candidates.push_back(Share(FrameOnArc(angle)));
  const auto expected = SelectSourceViews(sparse, candidates, 0, {});
  const auto ranked = SelectSourceViews(dense, candidates, 0, {});
  ASSERT_EQ(Indices(ranked), Indices(expected));
  for (size_t i = 0; i < ranked.size(); ++i) {
    // The wall's edge weighs a little more in the coarse grid.
    EXPECT_NEAR(ranked[i].score, expected[i].score, 0.02 * expected[i].score);
    EXPECT_NEAR(ranked[i].angle_deg, expected[i].angle_deg, 0.2);
  }
}

TEST(SelectSourceViewsTest, PrefersViewsThatListTheSameLandmarks) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  const std::vector<Eigen::Vector3d> half(reference.landmarks_in_world.begin(),
                                          reference.landmarks_in_world.begin() + 40);
  std::vector<Eigen::Vector3d> moved = Wall(4);
  for (auto& point : moved) point.x() += 1e-9;
  // The same geometry four times: nothing but the lists tells them apart.
  const std::vector<FramePtr> candidates = {WithLandmarks(FrameOnArc(8), {}), WithLandmarks(FrameOnArc(8), half),
                                            WithLandmarks(FrameOnArc(8), moved), WithLandmarks(FrameOnArc(8), Wall(4))};
  const auto ranked = SelectSourceViews(reference, candidates, 0, {});
  EXPECT_THAT(Indices(ranked), ElementsAre(3, 1, 0, 2));
  // A list whose points were all adjusted since is no evidence against the view.
  EXPECT_EQ(ranked[2].score, ranked[3].score);
  EXPECT_GT(ranked[3].score, 0);
}

TEST(SelectSourceViewsTest, KeepsTheBestAndBreaksTiesByIndex) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  std::vector<FramePtr> candidates(40, Share(FrameOnArc(10)));
  candidates.push_back(Share(FrameOnArc(2)));
  SourceViewOptions options;
  options.max_source_views = 3;
  EXPECT_THAT(Indices(SelectSourceViews(reference, candidates, 0, options)), ElementsAre(0, 1, 2));
  options.max_source_views = 32;
  EXPECT_EQ(SelectSourceViews(reference, candidates, 0, options).size(), 32u);
  EXPECT_THAT(SelectSourceViews(reference, {}, 0, options), IsEmpty());
}

TEST(SelectSourceViewsTest, DoesNotDependOnTheScenesUnit) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  const std::vector<double> angles = {2, 10, 35};
  const auto make = [&](double scale) {
    Frame scaled = FrameOnArc(0);
    scaled.cam_from_world.translation() *= scale;
    for (const auto& point : reference.landmarks_in_world) scaled.landmarks_in_world.push_back(scale * point);
    std::vector<FramePtr> candidates;
    for (const double angle : angles) {
      Frame candidate = FrameOnArc(angle);
      candidate.cam_from_world.translation() *= scale;
      candidates.push_back(Share(std::move(candidate)));
    }
    return SelectSourceViews(scaled, candidates, 0, {});
  };
  const auto expected = make(1);
  for (const double scale : {1e-4, 1e4}) {
    const auto ranked = make(scale);
    ASSERT_EQ(Indices(ranked), Indices(expected));
    // Rounding of double at the same relative size.
    for (size_t i = 0; i < ranked.size(); ++i) EXPECT_NEAR(ranked[i].score, expected[i].score, 1e-9);
  }
}

TEST(CountSourceViewsTest, TellsWhyCandidatesAreNotUseful) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  const std::vector<FramePtr> candidates = {Share(FrameOnArc(0)),   Share(FrameOnArc(0.5)),
                                            Share(FrameOnArc(0.8)), Share(FrameOnArc(10, 4, kCamera, {20, 2, 3})),
                                            Share(FrameOnArc(0.4)), Share(FrameOnArc(8)),
                                            Share(FrameOnArc(0))};
  const SourceViewCounts counts = SelectorFor(reference, 0, {}).Count(LandmarksOf(candidates));
  EXPECT_EQ(counts.no_baseline, 2);
  EXPECT_EQ(counts.small_angle, 3);
  EXPECT_EQ(counts.little_overlap, 1);
  EXPECT_EQ(counts.useful, 1);
  EXPECT_NEAR(counts.largest_angle_deg, 8, 0.2);
}

TEST(SourceViewSelectorTest, GivesTheSameWhetherItKnowsCandidatesOrNot) {
  Frame reference = FrameOnArc(0);
  reference.landmarks_in_world = Wall(4);
  SourceViewSelector selector = SelectorFor(reference, 0, {});
  auto candidates = LandmarksOf({Share(FrameOnArc(2)), Share(FrameOnArc(-12)), Share(FrameOnArc(35))});
  const auto first = selector.Select(candidates);
  EXPECT_THAT(Indices(first), ElementsAre(1, 0, 2));
  // One goes, and another one may get its place in memory.
  candidates.erase(candidates.begin() + 1);
  candidates.push_back(LandmarksOf({Share(FrameOnArc(8))}).front());
  const auto second = selector.Select(candidates);
  EXPECT_THAT(Indices(second), ElementsAre(2, 0, 1));
  EXPECT_EQ(second[1].score, first[1].score);
  EXPECT_EQ(selector.Count(candidates).useful, 3);
}

TEST(SelectSourceViewsTest, RefusesNullCandidatesAndBadOptions) {
  const Frame reference = FrameOnArc(0);
  EXPECT_THROW(SelectSourceViews(reference, {nullptr}, 1, {}), InvalidInputError);
  EXPECT_THROW(SelectorFor(reference, 1, {}).Select({nullptr}), InvalidInputError);
  EXPECT_THROW(SourceViewSelector(nullptr, 1, {}), InvalidInputError);
  for (const int bad : {0, 33}) EXPECT_THROW(SelectSourceViews(reference, {}, 1, {bad}), InvalidInputError) << bad;
}

}  // namespace
}  // namespace acmp
