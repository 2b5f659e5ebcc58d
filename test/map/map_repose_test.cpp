// Loop closures in the map.

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "acmp_mapping/map/map_store.h"

namespace acmp {
namespace {

constexpr int64_t kSecond = 1000000000;
constexpr double kExact = 1e-9;  ///< a few multiplications of matrices in double, values below 100
constexpr double kFloat = 1e-5;  ///< points are float32, values below 100

RigidTransform Pose(double x, double y, double yaw = 0) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() = Eigen::Vector3d(x, y, 0);
  pose.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return pose;
}

/// One point 2 in front of the camera.
PointCloud OnePoint() { return {{{0, 0, 2}, {0, 0, -1}, {1, 2, 3}, 0, 0.5f}}; }

void Add(MapStore* store, uint64_t id, int64_t stamp_ns, const RigidTransform& world_from_cam,
         const std::string& mapper = "mapper", uint64_t run = 0, const PathConvention& convention = {}) {
  EXPECT_TRUE(store->Add({mapper, run, id}, {stamp_ns, world_from_cam, convention}, OnePoint()));
}

/// Keyframes 0 to count - 1, one per second, a unit apart along x.
void AddKeyframes(MapStore* store, int count, int first = 0) {
  for (int i = first; i < first + count; ++i) Add(store, static_cast<uint64_t>(i), i * kSecond, Pose(i, 0));
}

void ExpectPath(const MapStore& store, const std::vector<RigidTransform>& expected) {
  const std::vector<StampedPose> path = store.Path();
  ASSERT_EQ(path.size(), expected.size());
  for (size_t i = 0; i < path.size(); ++i) {
    EXPECT_TRUE(path[i].pose.isApprox(expected[i], kExact))
        << "keyframe " << i << " at " << path[i].pose.translation().transpose() << ", expected "
        << expected[i].translation().transpose();
  }
}

TEST(MapRepose, NamedKeyframesGetThePosesOfThePath) {
  MapStore store({10, 0.1});
  AddKeyframes(&store, 3);
  const uint64_t version = store.version();
  const std::vector<RigidTransform> poses = {Pose(0, 0), Pose(1, 5, 0.5), Pose(2, 7, 1)};
  const ReposeResult result = store.Repose({{0, poses[0]}, {kSecond, poses[1]}, {2 * kSecond, poses[2]}});
  EXPECT_EQ(result.moved.size(), 2u) << "the first one is where it was";
  EXPECT_EQ(result.named, 3u);
  EXPECT_EQ(result.unmatched, 0u);
  EXPECT_NE(store.version(), version);
  ExpectPath(store, poses);
  const PointCloud map = store.WorldCloud().points;  // in the order of x
  ASSERT_EQ(map.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const Eigen::Vector3d point = poses[i] * Eigen::Vector3d(0, 0, 2);
    EXPECT_NEAR(map[i].position.x, point.x(), kFloat);
    EXPECT_NEAR(map[i].position.y, point.y(), kFloat);
    EXPECT_NEAR(map[i].position.z, point.z(), kFloat);
  }
}

TEST(MapRepose, StampsAreMatchedToTheNearest) {
  MapStore store({10, 0.1});
  const int64_t stamp = 1403636579763555584;  // a double resolves 119 ns there
  Add(&store, 0, stamp, Pose(0, 0));
  Add(&store, 1, stamp + kSecond, Pose(1, 0));
  const ReposeResult result = store.Repose({{stamp - 119, Pose(0, 1)},
                                            {stamp + 900000, Pose(0, 9)},  // within the tolerance, yet not the nearest
                                            {stamp + kSecond + 119, Pose(1, 1)},
                                            {stamp + kSecond / 2, Pose(5, 5)}});
  EXPECT_EQ(result.named, 2u);
  EXPECT_EQ(result.unmatched, 2u);
  ExpectPath(store, {Pose(0, 1), Pose(1, 1)});
  const MapStatistics statistics = store.statistics();
  EXPECT_EQ(statistics.paths, 1u);
  EXPECT_EQ(statistics.corrections, 1u);
  EXPECT_EQ(statistics.reposed, 2u);
  EXPECT_EQ(statistics.path_poses, 4u);
  EXPECT_EQ(statistics.path_unmatched, 2u);
}

TEST(MapRepose, TellsHowFarTheNearestStampIs) {
  MapStore store({10, 0.1});
  EXPECT_FALSE(store.Repose({{0, Pose(0, 0)}}).nearest) << "there is no keyframe";
  AddKeyframes(&store, 2);
  const uint64_t version = store.version();
  const ReposeResult result = store.Repose({{kSecond / 4, Pose(9, 9)}, {5 * kSecond, Pose(9, 9)}});
  EXPECT_EQ(result.named, 0u);
  EXPECT_EQ(result.unmatched, 2u);
  ASSERT_TRUE(result.nearest);
  EXPECT_EQ(result.nearest->gap_ns, kSecond / 4);
  EXPECT_EQ(result.nearest->tolerance_ns, 1000000);
  EXPECT_EQ(store.version(), version);
  ExpectPath(store, {Pose(0, 0), Pose(1, 0)});
  EXPECT_TRUE(store.Repose({}).moved.empty());
}

TEST(MapRepose, OthersMoveRigidlyWithTheNearestEarlierNamedKeyframe) {
  MapStore store({10, 0.1});
  AddKeyframes(&store, 6);
  const double quarter = M_PI / 2;
  // Keyframe 1 goes to (1, 10); keyframe 3 goes to (0, 20) and turns: what follows it turns with it.
  store.Repose({{kSecond, Pose(1, 10)}, {3 * kSecond, Pose(0, 20, quarter)}});
  const std::vector<RigidTransform> expected = {Pose(0, 10),          Pose(1, 10),          Pose(2, 10),
                                                Pose(0, 20, quarter), Pose(0, 21, quarter), Pose(0, 22, quarter)};
  ExpectPath(store, expected);
  // One that comes later, too; the next path replaces corrections and does not add to them.
  Add(&store, 6, 6 * kSecond, Pose(6, 0));
  EXPECT_TRUE(store.Path().back().pose.isApprox(Pose(0, 23, quarter), kExact));
  store.Repose({{3 * kSecond, Pose(3, 1)}});
  ExpectPath(store, {Pose(0, 10), Pose(1, 10), Pose(2, 10), Pose(3, 1), Pose(4, 1), Pose(5, 1), Pose(6, 1)});
}

TEST(MapRepose, TheSamePathIsFree) {
  MapStore store({10, 0.1});
  AddKeyframes(&store, 3);
  std::vector<StampedPose> path = {{0, Pose(0, 1)}, {kSecond, Pose(1, 2, 0.1)}, {2 * kSecond, Pose(2, 3, 0.2)}};
  store.Repose(path);
  const uint64_t version = store.version();
  EXPECT_TRUE(store.Repose(path).moved.empty());
  // Rounding: half of what counts as a change. What was not applied does not add up over many paths, either.
  for (int i = 0; i < 10; ++i) {
    path[1].pose.translation().x() = 1 + 0.5 * kSamePoseVoxels * 0.1;
    EXPECT_TRUE(store.Repose(path).moved.empty());
  }
  EXPECT_EQ(store.version(), version);
  EXPECT_EQ(store.statistics().corrections, 1u);
  EXPECT_EQ(store.statistics().paths, 12u);
  path[1].pose.translation().x() = 1 + 2 * kSamePoseVoxels * 0.1;
  EXPECT_EQ(store.Repose(path).moved, std::vector<size_t>{1});
  EXPECT_NE(store.version(), version);
  path[2].pose.rotate(Eigen::AngleAxisd(2 * kSamePoseRad, Eigen::Vector3d::UnitY()));
  EXPECT_EQ(store.Repose(path).moved, std::vector<size_t>{2});
  path[2].pose.rotate(Eigen::AngleAxisd(0.5 * kSamePoseRad, Eigen::Vector3d::UnitY()));
  EXPECT_TRUE(store.Repose(path).moved.empty());
}

/// The path of keyframes 0 to count - 1, the steps scaled by 1, and by `scale` from keyframe 20 on, as a loop closure
/// of a monocular frontend may leave it.
std::vector<StampedPose> ScaledPath(int count, double scale) {
  std::vector<StampedPose> path;
  double x = 0;
  for (int i = 0; i < count; ++i) {
    path.push_back({i * kSecond, Pose(x, 7)});
    x += i < 20 ? 1 : scale;
  }
  return path;
}

TEST(MapRepose, APathOfAnotherScaleScalesThePoints) {
  for (const double scale : {0.5, 1.3}) {
    MapStore store({100, 0.1});
    AddKeyframes(&store, 40);
    const std::vector<StampedPose> path = ScaledPath(40, scale);
    store.Repose(path);
    std::vector<RigidTransform> expected;
    for (const StampedPose& pose : path) expected.push_back(pose.pose);
    ExpectPath(store, expected);
    const PointCloud map = store.WorldCloud().points;
    ASSERT_EQ(map.size(), 40u);
    for (const SurfacePoint& point : map) {
      if (point.position.x > 14 && point.position.x < 20 + 6 * scale) continue;  // around the change
      EXPECT_NEAR(point.position.z, point.position.x < 20 ? 2 : 2 * scale, kFloat);
    }
    EXPECT_NEAR(store.statistics().smallest_scale, std::min(scale, 1.0), kExact);
    EXPECT_NEAR(store.statistics().largest_scale, std::max(scale, 1.0), kExact);
    const uint64_t version = store.version();
    EXPECT_TRUE(store.Repose(path).moved.empty());
    EXPECT_EQ(store.version(), version);
    // Keyframes that come later, or are not named, go on at the scale of the one before.
    AddKeyframes(&store, 2, 40);
    EXPECT_TRUE(store.Path().back().pose.isApprox(Pose(path.back().pose.translation().x() + 2 * scale, 7), kExact));
  }
}

/// Steps from face to face of a wide image, or from one camera of a rig to the other, are not those of the trajectory.
/// What lies beside the capture's camera goes on to lie there, in the new scale.
TEST(MapRepose, APathOfAnotherScaleScalesThePointsOfAllFacesAndCameras) {
  constexpr double kScale = 1.2;
  for (uint64_t faces = 1; faces <= 6; ++faces) {
    MapStore store({1000, 0.1});
    std::vector<StampedPose> path;
    for (int i = 0; i < 30; ++i) {
      for (uint64_t face = 0; face < faces; ++face) {
        KeyframePose pose = {i * kSecond, Pose(i, 0), {}};
        pose.view = face;
        pose.capture_from_cam = Pose(0, 0.1 * static_cast<double>(face), static_cast<double>(face) * M_PI / 3);
        for (const char* mapper : {"left", "right"}) {
          EXPECT_TRUE(store.Add({mapper, 0, static_cast<uint64_t>(i) * faces + face}, pose, OnePoint()));
        }
      }
      path.push_back({i * kSecond, Pose(kScale * i, 7)});
    }
    EXPECT_EQ(store.Repose(path).moved.size(), 60u) << "captures";
    for (const PlacedKeyframe& keyframe : store.Placed().keyframes) {
      EXPECT_NEAR(keyframe.scale, kScale, kExact) << faces;
      const auto face = static_cast<double>(keyframe.key.id % faces);
      const Eigen::Vector3d beside =
          kScale * Pose(static_cast<double>(keyframe.key.id / faces), 0.1 * face).translation();
      EXPECT_LT((keyframe.world_from_cam.translation() - beside - Eigen::Vector3d(0, 7, 0)).norm(), kExact) << faces;
    }
  }
}

TEST(MapRepose, ACorrectionOfPosesAloneScalesNothing) {
  MapStore store({100, 0.1});
  AddKeyframes(&store, 40);
  std::vector<StampedPose> path;
  for (int i = 0; i < 40; ++i) path.push_back({i * kSecond, Pose(i + 0.4 * std::sin(2.0 * i), i < 20 ? 0 : 9)});
  store.Repose(path);
  EXPECT_EQ(store.statistics().smallest_scale, 1);
  EXPECT_EQ(store.statistics().largest_scale, 1);
}

TEST(MapRepose, CorrectionsOutliveTheKeyframeTheyCameFrom) {
  MapStore store({2, 0.1});
  AddKeyframes(&store, 2);
  store.Repose({{0, Pose(0, 5)}});
  AddKeyframes(&store, 4, 2);  // the named keyframe is evicted long before the last one comes
  ExpectPath(store, {Pose(4, 5), Pose(5, 5)});
  // A path without it leaves the correction alone, though no keyframe here was ever named.
  store.Repose({{100 * kSecond, Pose(0, 0)}});
  ExpectPath(store, {Pose(4, 5), Pose(5, 5)});
}

TEST(MapRepose, CamerasOfARigMoveTogether) {
  // Two cameras of a body, 0.2 apart, the second turned; the path has poses of the body, stamped as the first's images.
  const RigidTransform body_from_cam[] = {Pose(0.1, 0), Pose(-0.1, 0, M_PI / 2)};
  MapStore store({10, 0.1});
  PathConvention convention;
  for (int i = 0; i < 3; ++i) {
    for (int camera = 0; camera < 2; ++camera) {
      convention.child_from_cam = body_from_cam[camera];
      Add(&store, static_cast<uint64_t>(i), i * kSecond + camera * kSecond / 2, Pose(i, 0) * body_from_cam[camera],
          camera == 0 ? "left" : "right", 0, convention);
    }
  }
  const RigidTransform correction = Pose(3, 4, 0.5);
  const ReposeResult result = store.Repose(
      {{0, correction * Pose(0, 0)}, {kSecond, correction * Pose(1, 0)}, {2 * kSecond, correction * Pose(2, 0)}});
  EXPECT_EQ(result.named, 3u) << "the second camera's images have other stamps";
  EXPECT_EQ(result.moved.size(), 6u);
  std::vector<RigidTransform> expected;
  for (const RigidTransform& mount : body_from_cam) {
    for (int i = 0; i < 3; ++i) expected.push_back(correction * Pose(i, 0) * mount);
  }
  ExpectPath(store, expected);
}

TEST(MapRepose, PosesMeanWhatTheKeyframeSays) {
  MapStore store({10, 0.1});
  PathConvention convention;
  convention.maps_world_to_child = true;
  Add(&store, 0, 0, Pose(1, 2), "mapper", 0, convention);
  store.Repose({{0, Pose(5, 6, 0.3).inverse()}});
  ExpectPath(store, {Pose(5, 6, 0.3)});

  MapStore unknown({10, 0.1});
  convention.child_from_cam.reset();
  Add(&unknown, 0, 0, Pose(1, 2), "mapper", 0, convention);
  const ReposeResult result = unknown.Repose({{0, Pose(5, 6)}});
  EXPECT_EQ(result.unresolved, 1u);
  EXPECT_EQ(result.named, 0u);
  ExpectPath(unknown, {Pose(1, 2)});

  MapStore tolerant({10, 0.1});
  convention = {};
  convention.tolerance_ns = kSecond / 2;
  Add(&tolerant, 0, 0, Pose(1, 2), "mapper", 0, convention);
  tolerant.Repose({{kSecond / 2, Pose(5, 6)}});
  ExpectPath(tolerant, {Pose(5, 6)});
}

TEST(MapRepose, APoseFarAwayIsRefusedAndTheOthersAreUsed) {
  MapStore store({10, 0.1});
  AddKeyframes(&store, 3);
  const double bound = kMaxMapVoxels * 0.1;
  for (const double far : {1e12, 1e308, 1.001 * bound, -1e12}) {
    const ReposeResult result = store.Repose({{0, Pose(0, 1)}, {kSecond, Pose(far, 0)}, {2 * kSecond, Pose(2, 3)}});
    EXPECT_EQ(result.named, 2u);
    EXPECT_EQ(result.unmatched, 0u);
    EXPECT_EQ(result.too_far, 1u);
    ASSERT_TRUE(result.first_too_far);
    EXPECT_EQ(result.first_too_far->stamp_ns, kSecond);
    EXPECT_EQ(result.first_too_far->position.x(), far);
    EXPECT_EQ(result.first_too_far->allowed.max_distance, bound);
    EXPECT_EQ(store.statistics().path_too_far, 1u);
    ExpectPath(store, {Pose(0, 1), Pose(1, 1), Pose(2, 3)});
    EXPECT_EQ(store.WorldCloud().points.size(), 3u);
  }
  const ReposeResult near = store.Repose({{kSecond, Pose(0.999 * bound, 0)}});
  EXPECT_EQ(near.too_far, 0u);
  EXPECT_EQ(store.statistics().path_too_far, 0u);
  EXPECT_EQ(store.WorldCloud().points.size(), 3u);
}

TEST(MapRepose, KeyframesThatOthersWouldMoveTooFarStay) {
  MapStore store({10, 0.1});
  const double bound = kMaxMapVoxels * 0.1;
  Add(&store, 0, 0, Pose(0, 0));
  Add(&store, 1, kSecond, Pose(0.9 * bound, 0));
  const ReposeResult result = store.Repose({{0, Pose(0.9 * bound, 0)}});  // the other one would go to 1.8
  EXPECT_EQ(result.too_far, 1u);
  EXPECT_EQ(result.first_too_far->stamp_ns, kSecond);
  ExpectPath(store, {Pose(0.9 * bound, 0), Pose(0.9 * bound, 0)});
  EXPECT_EQ(store.WorldCloud().points.size(), 1u) << "both see the same now";
}

}  // namespace
}  // namespace acmp
