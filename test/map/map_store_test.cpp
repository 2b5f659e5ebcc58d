#include "acmp_mapping/map/map_store.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "map/room_keyframes.h"
#include "support/error_text.h"

namespace acmp {
namespace {

PointCloud PlaneAt(float z, int side, float spacing) {
  PointCloud points;
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      points.push_back({{(i + 0.5f) * spacing, (j + 0.5f) * spacing, z}, {0, 0, -1}, {10, 20, 30}, 0, 0.5f});
    }
  }
  return points;
}

RigidTransform Shifted(double x) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation().x() = x;
  return pose;
}

KeyframeKey Key(uint64_t id, const std::string& mapper = "mapper", uint64_t run = 7) { return {mapper, run, id}; }

void Add(MapStore* store, const KeyframeKey& key, const RigidTransform& world_from_cam, const PointCloud& points) {
  EXPECT_TRUE(store->Add(key, {static_cast<int64_t>(key.id) * 100000000, world_from_cam, {}}, points));
  while (store->LookAroundNext()) continue;
}

void Add(MapStore* store, uint64_t id, const RigidTransform& world_from_cam, const PointCloud& points) {
  Add(store, Key(id), world_from_cam, points);
}

TEST(MapStore, PutsKeyframesIntoTheWorld) {
  MapStore store({10, 0.1});
  EXPECT_TRUE(store.WorldCloud().points.empty());
  RigidTransform turned = RigidTransform::Identity();  // world x = camera z
  turned.linear() << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  turned.translation() << 5, 0, 0;
  Add(&store, 0, turned, {{{0.05f, 0.05f, 2.05f}, {0, 0, -1}, {1, 2, 3}, 0, 0.25f}});
  const PointCloud map = store.WorldCloud().points;
  ASSERT_EQ(map.size(), 1u);
  // float32 of values below 10
  EXPECT_NEAR(map[0].position.x, 7.05, 1e-5);
  EXPECT_NEAR(map[0].position.y, 0.05, 1e-5);
  EXPECT_NEAR(map[0].position.z, -0.05, 1e-5);
  EXPECT_NEAR(map[0].normal.x, -1, 1e-5);
  EXPECT_EQ(map[0].color.g, 2);
}

TEST(MapStore, ThinsToOnePointPerVoxelAcrossKeyframes) {
  MapStore store({10, 0.1});
  Add(&store, 0, Shifted(0), PlaneAt(1.05f, 20, 0.05f));  // 1 m x 1 m
  EXPECT_EQ(store.statistics().points, 100u);
  EXPECT_FALSE(store.Add(Key(0), {0, Shifted(5), {}}, PlaneAt(1.05f, 20, 0.1f))) << "it is there";
  EXPECT_EQ(store.statistics().points, 100u);
  Add(&store, 1, Shifted(0.5), PlaneAt(1.05f, 20, 0.05f));
  EXPECT_EQ(store.statistics().points, 200u);
  EXPECT_EQ(store.WorldCloud().points.size(), 150u) << "the overlap counts once";
}

TEST(MapStore, PointsOfAKeyframeAreReplacedWhereItStillIs) {
  MapStore store({2, 0.1});
  Add(&store, 3, Shifted(0), PlaneAt(1.05f, 20, 0.05f));
  const uint64_t version = store.version();
  EXPECT_TRUE(store.Replace(Key(3), {}, PlaneAt(2.05f, 10, 0.05f)));
  EXPECT_NE(store.version(), version);
  EXPECT_EQ(store.statistics().points, 25u);
  EXPECT_EQ(store.statistics().keyframes, 1u);
  ASSERT_EQ(store.WorldCloud().points.size(), 25u);
  EXPECT_NEAR(store.WorldCloud().points[0].position.z, 2.05, 1e-5);
  EXPECT_TRUE(store.Replace(Key(3), {}, {}));
  EXPECT_TRUE(store.WorldCloud().points.empty());
  EXPECT_TRUE(store.Replace(Key(3), {}, PlaneAt(1.05f, 2, 0.1f))) << "no points are points, too";
  EXPECT_EQ(store.statistics().replaced, 3u);

  EXPECT_FALSE(store.Replace(Key(4), {}, PlaneAt(1.05f, 2, 0.05f))) << "it has not come";
  EXPECT_FALSE(store.Replace(Key(3, "other"), {}, PlaneAt(1.05f, 2, 0.05f))) << "another mapper's";
  EXPECT_FALSE(store.Replace(Key(3, "mapper", 8), {}, PlaneAt(1.05f, 2, 0.05f))) << "another run's";
  Add(&store, 5, Shifted(1), PlaneAt(1.05f, 2, 0.1f));
  Add(&store, 6, Shifted(2), PlaneAt(1.05f, 2, 0.1f));
  EXPECT_FALSE(store.Replace(Key(3), {}, PlaneAt(1.05f, 20, 0.05f))) << "it has made room";
  EXPECT_EQ(store.statistics().points, 8u);
  EXPECT_EQ(store.statistics().not_replaced, 4u);

  MapStore empty({2, 0});
  EXPECT_FALSE(empty.Replace(Key(0), {}, PlaneAt(1.05f, 20, 0.05f)));
  EXPECT_EQ(empty.statistics().voxel_size, 0) << "refused points tell nothing about the scene";
}

TEST(MapStore, MapsOfTwoMappersAreOneAndTheirOrderDoesNotCount) {
  // Points of unequal weights that share voxels: sums depend on their order.
  const auto points = [](uint64_t id) {
    PointCloud cloud = PlaneAt(1.05f, 20, 0.03f);
    for (size_t i = 0; i < cloud.size(); ++i) cloud[i].confidence = 1.0f / static_cast<float>(3 + (i * 7 + id) % 11);
    return cloud;
  };
  MapStore one({100, 0.1}), other({100, 0.1});
  for (uint64_t id = 0; id < 5; ++id) {
    const RigidTransform left_pose = Shifted(0.013 * static_cast<double>(id)), right_pose = Shifted(0.31);
    Add(&one, Key(id, "left"), left_pose, points(id));
    Add(&one, Key(id, "right"), right_pose, points(id + 50));
  }
  for (uint64_t id = 0; id < 5; ++id) Add(&other, Key(id, "right"), Shifted(0.31), points(id + 50));
  for (uint64_t id = 0; id < 5; ++id) {
    Add(&other, Key(id, "left"), Shifted(0.013 * static_cast<double>(id)), points(id));
  }
  EXPECT_EQ(one.statistics().keyframes, 10u);
  EXPECT_TRUE(SameBytes(one.WorldCloud().points, other.WorldCloud().points));
}

TEST(MapStore, ChoosesAVoxelSizeInProportionToTheScene) {
  for (const float scale : {0.001f, 1.0f, 1000.0f}) {
    MapStore store({10, 0});
    Add(&store, 0, Shifted(0), {});  // tells nothing about the scene
    EXPECT_EQ(store.statistics().voxel_size, 0);
    Add(&store, 1, Shifted(0), PlaneAt(4 * scale, 3, scale));
    EXPECT_NEAR(store.statistics().voxel_size, 0.02 * scale, 1e-6 * scale);  // float32
    Add(&store, 2, Shifted(0), PlaneAt(40 * scale, 3, scale));
    EXPECT_NEAR(store.statistics().voxel_size, 0.02 * scale, 1e-6 * scale) << "the grid stays";
  }
}

TEST(MapStore, EvictsTheOldestKeyframes) {
  MapStore store({2, 0.1});
  for (int i = 0; i < 5; ++i) Add(&store, i, Shifted(10.0 * i), PlaneAt(1, 1, 0.1f));
  const MapStatistics statistics = store.statistics();
  EXPECT_EQ(statistics.keyframes, 2u);
  EXPECT_EQ(statistics.evicted, 3u);
  EXPECT_EQ(statistics.points, 2u);
  for (const SurfacePoint& point : store.WorldCloud().points) EXPECT_GT(point.position.x, 29);
}

TEST(MapStore, EvictsWhatIsFartherThanTheRadiusFromTheNewest) {
  MapStore store({100, 0.1, 25});
  for (int i = 0; i < 5; ++i) Add(&store, i, Shifted(10.0 * i), PlaneAt(1, 1, 0.1f));
  MapStatistics statistics = store.statistics();
  EXPECT_EQ(statistics.keyframes, 3u) << "at 20, 30 and 40";
  EXPECT_EQ(statistics.evicted_by_radius, 2u);
  EXPECT_EQ(statistics.evicted, 0u) << "counted apart";
  EXPECT_EQ(statistics.points, 3u);
  EXPECT_EQ(store.Path().size(), 3u);
  // Back where it came from: order does not count, distance does.
  Add(&store, 5, Shifted(5), PlaneAt(1, 1, 0.1f));
  EXPECT_EQ(store.statistics().keyframes, 3u) << "at 20, 30 and 5";
}

TEST(MapStore, TheRadiusCountsFromTheNewestKeyframeOfEachMapper) {
  MapStore store({100, 0.1, 25});
  Add(&store, Key(0, "here"), Shifted(0), PlaneAt(1, 1, 0.1f));
  Add(&store, Key(0, "far away"), Shifted(1000), PlaneAt(1, 1, 0.1f));
  Add(&store, Key(1, "far away"), Shifted(1020), PlaneAt(1, 1, 0.1f));
  EXPECT_EQ(store.statistics().keyframes, 3u);
  Add(&store, Key(2, "far away"), Shifted(1040), PlaneAt(1, 1, 0.1f));
  EXPECT_EQ(store.statistics().keyframes, 3u) << "at 0, 1020 and 1040";
  EXPECT_EQ(store.statistics().evicted_by_radius, 1u);
}

TEST(MapStore, KeyframesOfEarlierRunsAreKeptOrNot) {
  for (const bool keep : {true, false}) {
    MapStore store({100, 0.1, 0, !keep});
    for (uint64_t id = 0; id < 3; ++id) {
      Add(&store, Key(id, "a", 100), Shifted(0), PlaneAt(1, 1, 0.1f));
      Add(&store, Key(id, "b", 200), Shifted(1), PlaneAt(1, 1, 0.1f));
    }
    Add(&store, Key(3, "a", 101), Shifted(2), PlaneAt(1, 1, 0.1f));
    EXPECT_EQ(store.statistics().keyframes, keep ? 7u : 4u) << "those of b have nothing to do with it";
    EXPECT_EQ(store.statistics().evicted_by_run, keep ? 0u : 3u);
  }
}

TEST(MapStore, ClearForgetsAllAndChangesTheVersion) {
  MapStore store({2, 0});
  const uint64_t empty = store.version();
  Add(&store, 0, Shifted(0), PlaneAt(1, 2, 0.1f));
  const uint64_t one = store.version();
  EXPECT_NE(one, empty);
  store.Clear();
  EXPECT_NE(store.version(), one);
  EXPECT_TRUE(store.WorldCloud().points.empty());
  EXPECT_EQ(store.statistics().voxel_size, 0) << "another scene may have another scale";
}

TEST(MapStore, KeyframesFarAwayAreRefused) {
  MapStore store({10, 0});
  const PointCloud points = PlaneAt(2, 3, 1);
  Add(&store, 0, Shifted(-1e7), points);
  const double bound = kMaxMapVoxels * kAutoVoxelRatio * 2;
  const KeyframePose far = {1, Shifted(1.5e7), {}};
  EXPECT_REFUSED(store.Add(Key(1), far, points), "position (1.5e+07, 0, 0)",
                 Concat("within ", bound, " of the map's first keyframe"));
  EXPECT_THROW(store.Replace(Key(0), {}, PlaneAt(2.1e7f, 1, 1)), InvalidInputError);
  EXPECT_THROW(MapStore({10, 0}).Add(Key(0), {0, Shifted(1e13), {}}, points), InvalidInputError)
      << "of the world's origin";
  KeyframePose second_view = {0, Shifted(-1e7), {}};
  second_view.view = 1;
  second_view.capture_from_cam = Shifted(5e7);
  EXPECT_THROW(store.Add(Key(1), second_view, points), InvalidInputError) << "by its place in its capture";
  second_view.capture_from_cam = RigidTransform::Identity();
  second_view.world_from_capture = Shifted(1e7);  // not where its capture lies
  EXPECT_THROW(store.Add(Key(1), second_view, PlaneAt(2.1e7f, 1, 1)), InvalidInputError);
  EXPECT_EQ(store.statistics().keyframes, 1u);
  EXPECT_EQ(store.WorldCloud().points.size(), points.size());
}

/// In UTM and geocentric coordinates float32 knows half metres only.
TEST(MapStore, IsTheSameFarFromTheOrigin) {
  const PointCloud points = PlaneAt(2, 30, 0.07f);
  MapStore near({10, 0});
  for (uint64_t i = 0; i < 3; ++i) Add(&near, i, Shifted(0.3 * static_cast<double>(i)), points);
  const MapCloud expected = near.WorldCloud();
  EXPECT_TRUE(expected.origin.isZero(0));
  for (const Eigen::Vector3d& offset : {Eigen::Vector3d(5e5, 5.5e6, 200), Eigen::Vector3d(-4.2e6, 6e5, 4.7e6)}) {
    MapStore store({10, 0});
    for (uint64_t i = 0; i < 3; ++i) {
      RigidTransform pose = Shifted(0.3 * static_cast<double>(i));
      pose.translation() += offset;
      Add(&store, i, pose, points);
    }
    const MapCloud cloud = store.WorldCloud();
    ASSERT_NEAR(static_cast<double>(cloud.points.size()), static_cast<double>(expected.points.size()),
                0.01 * static_cast<double>(expected.points.size()));
    const auto mean = [](const MapCloud& map) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const auto& p : map.points) sum += Eigen::Vector3d(p.position.x, p.position.y, p.position.z);
      return Eigen::Vector3d(map.origin + sum / static_cast<double>(map.points.size()));
    };
    EXPECT_LT((mean(cloud) - offset - mean(expected)).norm(), 1e-3);
    for (const auto& p : cloud.points) ASSERT_NEAR(cloud.origin.z() + p.position.z - offset.z(), 2, 1e-3);
    EXPECT_EQ(store.Path()[1].pose.translation(), Shifted(0.3).translation() + offset) << "the path stays in the world";
  }
}

/// A path that puts a map into geocentric coordinates, and keyframes that still come in the odometry's.
TEST(MapStore, ALoopClosureMayMoveItFarAway) {
  MapStore store({10, 0});
  const PointCloud points = PlaneAt(2, 3, 1);
  Add(&store, 0, Shifted(0), points);
  const Eigen::Vector3d offset(-4.2e6, 6e5, 4.7e6);
  RigidTransform moved = Shifted(0);
  moved.translation() += offset;
  EXPECT_EQ(store.Repose({{0, moved}}).named, 1u);
  Add(&store, 1, Shifted(1), points);
  const MapCloud cloud = store.WorldCloud();
  EXPECT_EQ(cloud.points.size(), 12u) << "two rows of three are the same";
  EXPECT_LT((store.Path()[1].pose.translation() - offset - Eigen::Vector3d(1, 0, 0)).norm(), 1e-6);
}

TEST(MapStore, AKeyframeThatIsRefusedDoesNotChooseTheVoxelSize) {
  MapStore store({10, 0});
  EXPECT_THROW(store.Add(Key(0), {0, Shifted(1), {}}, PlaneAt(1e-30f, 3, 1e-31f)), InvalidInputError);
  EXPECT_THROW(store.Add(Key(0), {0, Shifted(10.1), {}}, PlaneAt(1e-6f, 3, 1e-7f)), InvalidInputError);
  for (const float depth : {-2.0f, NAN, INFINITY}) {
    EXPECT_THROW(store.Add(Key(0), {0, Shifted(0), {}}, PlaneAt(depth, 3, 1)), InvalidInputError) << depth;
  }
  EXPECT_EQ(store.statistics().voxel_size, 0);
  Add(&store, 1, Shifted(1), PlaneAt(2, 3, 1));
  EXPECT_EQ(store.statistics().voxel_size, kAutoVoxelRatio * 2);
}

/// A wall 4 in front of cameras side by side, and before it what is in the way at 2, of all or some of them.
PointCloud WallWith(bool with_post) {
  PointCloud points;
  for (int i = -60; i < 60; ++i) {
    for (int j = -40; j < 40; ++j) {
      const bool post = with_post && std::abs(i) < 6;
      const float z = post ? 2 : 4, scale = post ? 0.5f : 1;
      points.push_back({{0.02f * i * scale, 0.02f * j * scale, z}, {0, 0, -1}, {10, 20, 30}, 0, 0.5f});
    }
  }
  return points;
}

size_t PointsNear(const PointCloud& points) {
  return static_cast<size_t>(
      std::count_if(points.begin(), points.end(), [](const auto& p) { return p.position.z < 3; }));
}

TEST(MapStore, WhatLaterKeyframesLookThroughLeavesTheMap) {
  MapStore store({50, 0.02});
  Add(&store, 0, Shifted(0), WallWith(true));
  ASSERT_GT(PointsNear(store.WorldCloud().points), 100u);
  for (uint64_t id = 1; id <= 2; ++id) Add(&store, id, Shifted(0.05 * id), WallWith(false));
  EXPECT_GT(PointsNear(store.WorldCloud().points), 100u) << "two may be wrong";
  Add(&store, 3, Shifted(0.15), WallWith(false));
  EXPECT_EQ(PointsNear(store.WorldCloud().points), 0u);
  EXPECT_GT(store.statistics().looked_through, 100u);
  // What comes to stand there later stays: earlier keyframes have no say.
  Add(&store, 4, Shifted(0), WallWith(true));
  EXPECT_GT(PointsNear(store.WorldCloud().points), 100u);
}

TEST(MapStore, WhatSomeConfirmStaysAndGainsConfidence) {
  MapStore store({50, 0.02});
  for (uint64_t id = 0; id < 12; ++id) Add(&store, id, Shifted(0), WallWith(id % 3 != 2));
  const PointCloud first = store.Session().keyframes[0].points_in_camera->Unpack();
  EXPECT_GT(PointsNear(first), 100u) << "seven later ones see it, four look through it";
  MapStore wall({50, 0.02});
  for (uint64_t id = 0; id < 3; ++id) Add(&wall, id, Shifted(0), WallWith(false));
  const MapSession session = wall.Session();
  // Odds of 1 rise by a fifth with each of the two that come after the first.
  const auto confidence = [&](size_t i) { return session.keyframes[i].points_in_camera->Unpack().at(2400).confidence; };
  constexpr double kStep = 1.0 / 65535;  // that a map keeps; half of one is lost with each look
  EXPECT_NEAR(confidence(0), 1.44 / 2.44, 1.5 * kStep);
  EXPECT_NEAR(confidence(2), 0.5, 0.5 * kStep);
}

TEST(MapStore, FacesOfAWideImageAreOneCapture) {
  MapStore store({2, 0.1});
  for (uint64_t id = 0; id < 9; ++id) {
    KeyframePose pose = {static_cast<int64_t>(id / 3), Shifted(static_cast<double>(id / 3)), {}};
    pose.view = id % 3;
    EXPECT_TRUE(store.Add(Key(id), pose, PlaneAt(2, 3, 1)));
    EXPECT_EQ(store.Path().size(), std::min<size_t>(id / 3 + 1, 2));
  }
  EXPECT_EQ(store.statistics().keyframes, 6u) << "of two captures; the first one went as a whole";
  EXPECT_EQ(store.statistics().evicted, 3u);
  MapStore other({1, 0.1}), large({2, 0.1});
  EXPECT_THROW(other.Join(store.Session(), RigidTransform::Identity()), InvalidInputError);
  large.Join(store.Session(), RigidTransform::Identity());
  EXPECT_EQ(large.statistics().keyframes, 6u);
}

TEST(MapStore, LooksThatRemovePointsChangeTheVersion) {
  MapStore store({50, 0.02});
  for (uint64_t id = 0; id < 3; ++id) Add(&store, id, Shifted(0.05 * id), WallWith(id == 0));
  EXPECT_TRUE(store.Add(Key(3), {300000000, Shifted(0.15), {}}, WallWith(false)));
  const uint64_t version = store.version();
  EXPECT_TRUE(store.LookAroundNext());
  EXPECT_NE(store.version(), version) << "what is latched has to be published again";
}

/// A map that is behind lets them look later: nothing is other than if they had looked at once.
TEST(MapStore, KeyframesMayLookAroundLater) {
  MapStore at_once({50, 0.02}), later({50, 0.02}), small({2, 0.02});
  const auto change = [](MapStore* store, const auto& looks) {
    for (uint64_t id = 0; id < 8; ++id) {
      const KeyframePose pose = {static_cast<int64_t>(id), Shifted(0.05 * static_cast<double>(id)), {}};
      EXPECT_TRUE(store->Add(Key(id), pose, WallWith(id == 0 || id == 2)));
      looks(store);
      // One that has looked, or not, and was looked at by two: it forgets those, and is looked at by later ones only.
      if (id == 4) {
        EXPECT_TRUE(store->Replace(Key(2), pose, WallWith(true)));
      }
    }
  };
  const auto look = [](MapStore* store) {
    while (store->LookAroundNext()) continue;
  };
  change(&at_once, look);
  change(&later, [](MapStore*) {});
  EXPECT_EQ(later.statistics().yet_to_look, 7u) << "there was nothing around the first one";
  look(&later);
  EXPECT_EQ(later.statistics().yet_to_look, 0u);
  EXPECT_FALSE(later.LookAroundNext());
  EXPECT_GT(at_once.statistics().looked_through, 100u);
  EXPECT_EQ(later.statistics().looked_through, at_once.statistics().looked_through);
  EXPECT_TRUE(SameBytes(later.WorldCloud().points, at_once.WorldCloud().points));
  // What makes room for others before has no points any more that could wait.
  for (uint64_t id = 0; id < 8; ++id)
    EXPECT_TRUE(small.Add(Key(id), {static_cast<int64_t>(id), Shifted(0), {}}, WallWith(false)));
  EXPECT_EQ(small.statistics().never_looked, 5u);
  EXPECT_EQ(small.statistics().yet_to_look, 2u);
  small.Clear();
  EXPECT_FALSE(small.LookAroundNext());
}

TEST(MapStore, KeyframesWhosePosesDoNotFitRemoveNothing) {
  MapStore store({50, 0.02});
  Add(&store, 0, Shifted(0), WallWith(false));
  const size_t before = store.WorldCloud().points.size();
  RigidTransform back = RigidTransform::Identity();
  back.translation().z() = 0.6;  // 15 % of the depth: they look through all of the wall
  for (uint64_t id = 1; id <= 5; ++id) Add(&store, id, back, WallWith(false));
  EXPECT_EQ(store.Session().keyframes[0].points_in_camera->size(), before);
  EXPECT_EQ(store.statistics().looked_through, 0u);
}

}  // namespace
}  // namespace acmp
