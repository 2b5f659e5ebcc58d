#include "acmp_mapping/ros/map_store.h"

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

PointCloud PlaneAt(float z, int side, float spacing) {
  PointCloud points;
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      points.push_back({{(i + 0.5f) * spacing, (j + 0.5f) * spacing, z}, {0, 0, -1}, {10, 20, 30}, 0.5f});
    }
  }
  return points;
}

RigidTransform Shifted(double x) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation().x() = x;
  return pose;
}

void Add(MapStore* store, int64_t id, const RigidTransform& world_from_cam, const PointCloud& points) {
  store->AddPoints(id, id * 100000000, world_from_cam, points);
}

TEST(MapStore, PutsKeyframesIntoTheWorld) {
  MapStore store({10, 0.1});
  EXPECT_TRUE(store.WorldCloud().empty());
  RigidTransform turned = RigidTransform::Identity();  // world x = camera z
  turned.linear() << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  turned.translation() << 5, 0, 0;
  Add(&store, 0, turned, {{{0.05f, 0.05f, 2.05f}, {0, 0, -1}, {1, 2, 3}, 0.25f}});
  const PointCloud map = store.WorldCloud();
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
  Add(&store, 1, Shifted(0.5), PlaneAt(1.05f, 20, 0.05f));
  EXPECT_EQ(store.statistics().points, 200u);
  EXPECT_EQ(store.WorldCloud().size(), 150u) << "the overlap counts once";
}

TEST(MapStore, PointsOfAKeyframeAreReplacedWhereItStillIs) {
  MapStore store({2, 0.1});
  Add(&store, 3, Shifted(0), PlaneAt(1.05f, 20, 0.05f));
  const uint64_t version = store.version();
  EXPECT_TRUE(store.ReplacePoints(3, PlaneAt(2.05f, 10, 0.05f)));
  EXPECT_NE(store.version(), version);
  EXPECT_EQ(store.statistics().points, 25u);
  EXPECT_EQ(store.statistics().keyframes, 1u);
  ASSERT_EQ(store.WorldCloud().size(), 25u);
  EXPECT_NEAR(store.WorldCloud()[0].position.z, 2.05, 1e-5);
  EXPECT_TRUE(store.ReplacePoints(3, {}));
  EXPECT_TRUE(store.WorldCloud().empty());

  store.AddPose(4, 400000000, Shifted(1));
  EXPECT_FALSE(store.ReplacePoints(4, PlaneAt(1.05f, 2, 0.05f))) << "it has had no points";
  EXPECT_TRUE(store.HasPoints(3)) << "none is points, too";
  EXPECT_FALSE(store.HasPoints(4));
  EXPECT_FALSE(store.ReplacePoints(7, PlaneAt(1.05f, 2, 0.05f)));
  Add(&store, 5, Shifted(1), PlaneAt(1.05f, 2, 0.1f));
  Add(&store, 6, Shifted(2), PlaneAt(1.05f, 2, 0.1f));
  EXPECT_FALSE(store.ReplacePoints(3, PlaneAt(1.05f, 20, 0.05f))) << "it has made room";
  EXPECT_FALSE(store.HasPoints(3));
  EXPECT_EQ(store.statistics().points, 8u);

  MapStore empty({2, 0});
  EXPECT_FALSE(empty.ReplacePoints(0, PlaneAt(1.05f, 20, 0.05f)));
  EXPECT_EQ(empty.statistics().voxel_size, 0) << "refused points tell nothing about the scene";
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
  for (const SurfacePoint& point : store.WorldCloud()) EXPECT_GT(point.position.x, 29);
  store.set_options({1, 0.1});
  Add(&store, 5, Shifted(50), PlaneAt(1, 1, 0.1f));
  EXPECT_EQ(store.statistics().keyframes, 1u);
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
  // A new option counts from the next keyframe on; 0 means no limit.
  store.set_options({100, 0.1, 0});
  Add(&store, 6, Shifted(1000), PlaneAt(1, 1, 0.1f));
  EXPECT_EQ(store.statistics().keyframes, 4u);
  store.set_options({100, 0.1, 1});
  Add(&store, 7, Shifted(1000.5), PlaneAt(1, 1, 0.1f));
  EXPECT_EQ(store.statistics().keyframes, 2u);
}

TEST(MapStore, TheRadiusCountsFromTheNewestPoseAndChangesTheVersion) {
  MapStore store({100, 0.1, 25});
  Add(&store, 0, Shifted(0), PlaneAt(1, 1, 0.1f));
  const uint64_t version = store.version();
  store.AddPose(1, 100000000, Shifted(10));
  EXPECT_EQ(store.version(), version) << "a pose alone changes no map";
  store.AddPose(2, 200000000, Shifted(100));
  EXPECT_NE(store.version(), version);
  EXPECT_TRUE(store.WorldCloud().empty());
  Add(&store, 1, Shifted(10), PlaneAt(1, 1, 0.1f));
  EXPECT_EQ(store.statistics().keyframes, 0u) << "refined when the camera was far away already";
  EXPECT_EQ(store.statistics().evicted_by_radius, 2u);
}

TEST(MapStore, PosesWithoutPointsNeverPushOutThoseWithPoints) {
  MapStore store({2, 0.1});
  for (int i = 0; i < 2; ++i) Add(&store, i, Shifted(i), PlaneAt(1, 1, 0.1f));
  for (int i = 2; i < 10; ++i) store.AddPose(i, i, Shifted(i));
  EXPECT_EQ(store.statistics().keyframes, 2u);
  EXPECT_EQ(store.statistics().evicted, 0u);
  EXPECT_EQ(store.Path().size(), 4u) << "bounded all the same";
  Add(&store, 3, Shifted(3), PlaneAt(1, 1, 0.1f));  // its pose went before its points came
  EXPECT_EQ(store.statistics().keyframes, 2u);
  EXPECT_EQ(store.Path().front().world_from_cam.translation().x(), 1);
}

TEST(MapStore, ClearForgetsAllAndChangesTheVersion) {
  MapStore store({2, 0});
  const uint64_t empty = store.version();
  Add(&store, 0, Shifted(0), PlaneAt(1, 2, 0.1f));
  const uint64_t one = store.version();
  EXPECT_NE(one, empty);
  store.Clear();
  EXPECT_NE(store.version(), one);
  EXPECT_TRUE(store.WorldCloud().empty());
  EXPECT_EQ(store.statistics().voxel_size, 0) << "another scene may have another scale";
}

TEST(MapStore, RefusesBadOptions) {
  EXPECT_THROW(MapStore({0, 0.1}), InvalidInputError);
  EXPECT_THROW(MapStore({1, -0.1}), InvalidInputError);
  EXPECT_THROW(MapStore({1, 0.1, -1}), InvalidInputError);
}

}  // namespace
}  // namespace acmp
