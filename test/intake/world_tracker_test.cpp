// What frontends send while they start, when they lose track and when they close a loop. All scales are arbitrary.

#include "acmp_mapping/intake/world_tracker.h"

#include <cmath>

#include "intake/samples.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using Verdict = WorldTracker::Verdict;
using Points = std::vector<Eigen::Vector3d>;

constexpr int64_t kFrameNs = 100000000;

/// A wavy wall about 4 in front of the origin, far to all sides, moved by `shift` and then scaled.
Points Wall(double scale = 1, const Eigen::Vector3d& shift = Eigen::Vector3d::Zero()) {
  Points points;
  for (int col = -30; col <= 30; ++col) {
    for (int row = -8; row <= 8; ++row) {
      const Eigen::Vector3d point(0.21 * col, 0.2 * row, 4 + 0.5 * std::sin(0.3 * col));
      points.push_back(scale * (point + shift));
    }
  }
  return points;
}

/// A frontend at 10 Hz whose camera moves to the right.
class Frontend {
 public:
  explicit Frontend(double unit = 1) : unit_(unit) {}

  Verdict Send(const Points& landmarks, const Eigen::Vector3d& position, bool has_empty_cloud = false) {
    WorldTracker::Sample sample;
    sample.stamp_ns = ++frames_ * kFrameNs;
    sample.world_from_cam.translation() = unit_ * position;
    sample.camera = kVgaCamera;
    for (const Eigen::Vector3d& point : landmarks) sample.landmarks_in_world.push_back(unit_ * point);
    sample.has_empty_cloud = has_empty_cloud;
    sample.scene_depth = 4 * unit_;
    last = tracker.Add(std::move(sample));
    return last.verdict;
  }
  Verdict Send(const Points& landmarks, double x) { return Send(landmarks, Eigen::Vector3d(x, 0, 0)); }
  Verdict SendEmpty() { return Send({}, Eigen::Vector3d::Zero(), true); }

  WorldTracker tracker;
  WorldTracker::Judgement last;

 private:
  double unit_;
  int64_t frames_ = 0;
};

/// What a bundle adjustment does to a settled map.
Points Adjusted(Points points, int round) {
  for (size_t i = 0; i < points.size(); ++i) points[i] *= 1 + 0.004 * std::sin(static_cast<double>(i) + 10 * round);
  return points;
}

TEST(WorldTracker, WaitsForNothingBesideARunningFrontend) {
  for (const double unit : {0.01, 1.0, 100.0}) {
    Frontend frontend(unit);
    for (int i = 0; i < 50; ++i) EXPECT_EQ(frontend.Send(Adjusted(Wall(), i / 3), 0.05 * i), Verdict::kUse);
  }
}

TEST(WorldTracker, UsesNothingOfAFrontendBeforeItHasLandmarks) {
  Frontend frontend;
  EXPECT_EQ(frontend.SendEmpty(), Verdict::kWait);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(frontend.SendEmpty(), Verdict::kNotInitialised);
  EXPECT_THAT(frontend.last.reason, HasSubstr("no usable point"));
  EXPECT_EQ(frontend.Send(Wall(), 0), Verdict::kWait);
}

TEST(WorldTracker, AnEmptyCloudAloneIsNoStart) {
  Frontend frontend;
  EXPECT_EQ(frontend.SendEmpty(), Verdict::kWait);
  EXPECT_EQ(frontend.Send(Wall(), 0), Verdict::kUse);
  Frontend moving;
  EXPECT_EQ(moving.SendEmpty(), Verdict::kWait);
  EXPECT_EQ(moving.Send({}, Eigen::Vector3d(0.1, 0, 0), true), Verdict::kUse);
  EXPECT_EQ(moving.Send(Wall(), 0.2), Verdict::kUse);
}

TEST(WorldTracker, UsesNothingUntilTheScaleHasSettled) {
  for (const double unit : {0.01, 1.0, 100.0}) {
    Frontend frontend(unit);
    for (int i = 0; i < 2; ++i) frontend.SendEmpty();
    EXPECT_EQ(frontend.Send(Wall(2), 0), Verdict::kWait);
    EXPECT_EQ(frontend.Send(Wall(2), 0.1), Verdict::kWait) << "the same numbers again tell nothing";
    EXPECT_EQ(frontend.Send(Wall(1.3), 0.1), Verdict::kNotSettled);
    EXPECT_EQ(frontend.Send(Wall(1.0), 0.1), Verdict::kNotSettled);
    EXPECT_THAT(frontend.last.reason, HasSubstr("still settles"));
    EXPECT_EQ(frontend.Send(Adjusted(Wall(), 1), 0.15), Verdict::kWait) << "one adjustment";
    EXPECT_EQ(frontend.Send(Adjusted(Wall(), 1), 0.2), Verdict::kWait);
    EXPECT_EQ(frontend.Send(Adjusted(Wall(), 2), 0.25), Verdict::kUse) << "another one";
    EXPECT_EQ(frontend.Send(Adjusted(Wall(), 3), 0.3), Verdict::kUse);
  }
}

TEST(WorldTracker, DoesNotWaitForEverWhereLandmarksAreNeverAdjusted) {
  Frontend frontend;
  for (int i = 0; i < 2; ++i) frontend.SendEmpty();
  int waited = 0;
  while (frontend.Send(Wall(), 0.01 * waited) == Verdict::kWait) ++waited;
  EXPECT_EQ(frontend.last.verdict, Verdict::kUse);
  EXPECT_LT(waited, 31);
}

TEST(WorldTracker, ANewScaleIsANewWorld) {
  Frontend frontend;
  for (int i = 0; i < 10; ++i) frontend.Send(Wall(), 0.05 * i);
  EXPECT_EQ(frontend.Send(Wall(1.2), 0.6), Verdict::kNewWorld);
  EXPECT_THAT(frontend.last.reason, HasSubstr("landmarks only"));
  EXPECT_EQ(frontend.Send(Adjusted(Wall(1.2), 1), 0.65), Verdict::kWait) << "it starts anew";
  EXPECT_EQ(frontend.Send(Adjusted(Wall(1.2), 2), 0.7), Verdict::kUse);
}

TEST(WorldTracker, ALoopClosureIsANewWorldAndASmallCorrectionIsNot) {
  Frontend frontend;
  for (int i = 0; i < 10; ++i) frontend.Send(Wall(), 0.05 * i);
  EXPECT_EQ(frontend.Send(Wall(1, {0, 0, 0.1}), 0.55), Verdict::kUse);
  EXPECT_EQ(frontend.Send(Wall(1, {0, 0, 0.8}), 0.6), Verdict::kNewWorld);
}

TEST(WorldTracker, AWorldFarAwayIsANewOne) {
  Frontend frontend;
  for (int i = 0; i < 10; ++i) frontend.Send(Wall(), 0.05 * i);
  Points elsewhere = Wall();
  for (Eigen::Vector3d& point : elsewhere) point.x() += 100;
  EXPECT_EQ(frontend.Send(elsewhere, 100), Verdict::kNewWorld);
}

TEST(WorldTracker, WithoutLandmarksAJumpOfTheCameraTells) {
  const auto walk = [](Frontend* frontend) {
    double x = 0;
    for (int i = 0; i < 20; ++i) EXPECT_EQ(frontend->Send({}, x += 0.05), Verdict::kUse);
    return x;
  };
  Frontend jumping;
  EXPECT_EQ(jumping.Send({}, walk(&jumping) + 5), Verdict::kNewWorld);
  Frontend hurrying;
  EXPECT_EQ(hurrying.Send({}, walk(&hurrying) + 3), Verdict::kUse) << "still less than the scene's depth";
  Frontend driving;
  for (int i = 0; i < 30; ++i) EXPECT_EQ(driving.Send({}, 5.0 * i), Verdict::kUse) << "always fast";
}

TEST(WorldTracker, FewLandmarksTellNothing) {
  Frontend frontend;
  const Points wall = Wall();
  for (int i = 0; i < 10; ++i) {
    Points few(wall.begin() + 500 + i, wall.begin() + 510 + i);
    for (Eigen::Vector3d& point : few) point *= 1 + 0.5 * (i % 2);
    EXPECT_EQ(frontend.Send(few, 0.05 * i), Verdict::kUse);
  }
}

}  // namespace
}  // namespace acmp
