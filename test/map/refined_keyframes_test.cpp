// Keyframes whose poses the mapper has refined.

#include <gtest/gtest.h>

#include "acmp_mapping/map/map_store.h"

namespace acmp {
namespace {

constexpr int64_t kStep_ns = 1000000000;
constexpr int kKeyframes = 24;
constexpr double kRounding = 1e-5;  ///< points are float32, values below 10
const Eigen::Vector3d kPoint(1.2, 0.3, 4);

RigidTransform True(int i) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() << 0.1 * i, 0.02 * (i % 3), 0;
  return pose;
}

/// The true pose, off by 3 cm to one side and the other.
RigidTransform Received(int i) {
  RigidTransform pose = True(i);
  pose.translation().y() += i % 2 == 0 ? 0.03 : -0.03;
  return pose;
}

/// Refined poses are true but for the scale of their world: all is twice as large there.
KeyframePose PoseOf(int i, uint64_t world = 1) {
  KeyframePose pose;
  pose.stamp_ns = i * kStep_ns;
  pose.world_from_capture = True(i);
  pose.world_from_capture.translation().x() += 0.01;  // as the window lay then
  RigidTransform refined = True(i);
  refined.translation() *= 2;
  pose.refined = RefinedAndReceived{{world, refined, 0.5}, Received(i)};
  return pose;
}

/// The same point of the world, as each camera sees it.
PointCloud PointOf(int i) {
  const Eigen::Vector3f p = (True(i).inverse() * kPoint).cast<float>();
  return {{{p.x(), p.y(), p.z()}, {0, 0, -1}, {1, 2, 3}, 0, 0.5f}};
}

KeyframeKey KeyOf(int i) { return {"mapper", 1, static_cast<uint64_t>(i)}; }

void FillRefined(MapStore* store, int count = kKeyframes) {
  for (int i = 0; i < count; ++i) EXPECT_TRUE(store->Add(KeyOf(i), PoseOf(i), PointOf(i)));
}

/// Of all keyframes, in the world.
std::vector<Eigen::Vector3d> PointsOf(const MapStore& store) {
  std::vector<Eigen::Vector3d> points;
  for (const PlacedKeyframe& keyframe : store.Placed().keyframes) {
    const Vec3f p = (*keyframe.points_in_camera)[0].position;
    points.push_back(keyframe.world_from_cam * (keyframe.scale * Eigen::Vector3d(p.x, p.y, p.z)));
  }
  return points;
}

TEST(RefinedKeyframes, FitTogetherThoughReceivedPosesDoNot) {
  MapStore store({100, 0.001});
  FillRefined(&store);
  for (const Eigen::Vector3d& point : PointsOf(store)) {
    EXPECT_NEAR((point - PointsOf(store).front()).norm(), 0, 0.004) << "received ones: 0.06";
    EXPECT_NEAR((point - kPoint).norm(), 0, 0.02) << "errors of 3 cm in turn, the weights fall along the trajectory";
  }
}

TEST(RefinedKeyframes, AreWhereTheMapperPutThemWhileTheyAreFew) {
  MapStore store({100, 0.001});
  FillRefined(&store, 3);
  for (const Eigen::Vector3d& point : PointsOf(store)) {
    EXPECT_NEAR((point - kPoint - Eigen::Vector3d(0.01, 0, 0)).norm(), 0, kRounding);
  }
}

TEST(RefinedKeyframes, FollowALoopClosureWithItsScale) {
  MapStore store({100, 0.001});
  FillRefined(&store);
  std::vector<StampedPose> path;
  Similarity closure;
  closure.scale = 1.3;
  closure.rigid.translation() << 5, 6, 7;
  for (int i = 0; i < kKeyframes; ++i) path.push_back({i * kStep_ns, closure.Moved(Received(i))});
  store.Repose(path);
  const Eigen::Vector3d expected = closure.rigid * (1.3 * kPoint);
  for (const Eigen::Vector3d& point : PointsOf(store)) EXPECT_NEAR((point - expected).norm(), 0, 1.3 * 0.02);
}

TEST(RefinedKeyframes, TakeTheirNewPlaceWithBetterPoints) {
  MapStore store({100, 0.001});
  FillRefined(&store);
  KeyframePose better = PoseOf(3);
  better.refined->refined.world_from_cam.translation().z() += 0.2;  // 0.1 in the world of the received poses
  ASSERT_TRUE(store.Replace(KeyOf(3), better, PointOf(3)));
  const std::vector<Eigen::Vector3d> points = PointsOf(store);
  EXPECT_NEAR(points[3].z() - points[2].z(), 0.1, 0.01);
  better.refined.reset();
  ASSERT_TRUE(store.Replace(KeyOf(3), better, PointOf(3)));
  EXPECT_TRUE(store.Path()[3].pose.isApprox(Received(3)));
}

TEST(RefinedKeyframes, ComeBackFromASessionAsTheyWere) {
  for (const bool is_closed : {false, true}) {
    MapStore store({100, 0.001}), other({100, 0.001});
    FillRefined(&store);
    if (is_closed) store.Repose({{0, Received(0)}, {9 * kStep_ns, Received(12)}});
    other.Join(store.Session(), RigidTransform::Identity());
    const std::vector<Eigen::Vector3d> before = PointsOf(store), after = PointsOf(other);
    ASSERT_EQ(before.size(), after.size());
    // Points are rounded to float32 once more, values below 10.
    for (size_t i = 0; i < before.size(); ++i) EXPECT_LT((before[i] - after[i]).norm(), kRounding) << i;
    for (const SessionKeyframe& saved : store.Session().keyframes) {
      const Vec3f p = (*saved.points_in_camera)[0].position;
      const Eigen::Vector3d point = saved.pose.world_from_capture * Eigen::Vector3d(p.x, p.y, p.z);
      EXPECT_LT((point - before[saved.key.id]).norm(), kRounding) << "readers of the file need nothing else";
    }
  }
}

TEST(RefinedKeyframes, AnUnusableWorldLeavesTheMapUsable) {
  MapStore store({100, 0.001});
  FillRefined(&store);
  for (int i = kKeyframes; i < kKeyframes + 6; ++i) {
    KeyframePose pose = PoseOf(i, 2);
    pose.refined->refined.world_from_cam.translation() *= 1e-12;
    EXPECT_TRUE(store.Add(KeyOf(i), pose, PointOf(i)));
  }
  EXPECT_FALSE(store.WorldCloud().points.empty());
}

}  // namespace
}  // namespace acmp
