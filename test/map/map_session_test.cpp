// A map that another one takes over.

#include "acmp_mapping/map/map_store.h"
#include "map/room_keyframes.h"
#include "support/error_text.h"

namespace acmp::test {
namespace {

constexpr double kSessionVoxel = 0.1;
constexpr int64_t kSecond = 1000000000;

RigidTransform Shifted(double x, double y = 0) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() << x, y, 0.25;
  pose.rotate(Eigen::AngleAxisd(0.1 * x, Eigen::Vector3d(1, 2, 3).normalized()));
  return pose;
}

/// A slanted wall, several points per voxel.
PointCloud Wall(float depth = 4) {
  PointCloud points;
  for (int i = 0; i < 400; ++i) {
    const float x = 0.033f * static_cast<float>(i % 20), y = 0.031f * static_cast<float>(i / 20);
    points.push_back(
        {{x, y, depth + 0.3f * x}, {0.6f, 0, -0.8f}, {10, static_cast<unsigned char>(i % 200), 30}, 0, 0.7f});
  }
  return points;
}

KeyframePose PoseAt(int64_t second, const RigidTransform& world_from_cam) {
  return {second * kSecond, world_from_cam, {}, "path", std::nullopt, "camera", {64, 48, 50, 50, 31.5, 23.5}};
}

void Add(MapStore* store, const KeyframeKey& key, double x) {
  EXPECT_TRUE(store->Add(key, PoseAt(static_cast<int64_t>(key.id), Shifted(x)), Wall()));
}

/// Two runs of one mapper and one of another, of which the last ones were corrected.
void Fill(MapStore* store) {
  Add(store, {"a", 1, 0}, 0);
  Add(store, {"a", 2, 0}, 1);
  Add(store, {"b", 5, 1}, 2);
  Add(store, {"a", 2, 1}, 3);
  store->Repose({{0, Shifted(1, 7)}, {kSecond, Shifted(3.1, 7)}});
}

void ExpectSamePath(const std::vector<StampedPose>& a, const std::vector<StampedPose>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].stamp_ns, b[i].stamp_ns);
    EXPECT_EQ(a[i].pose.matrix(), b[i].pose.matrix());
  }
}

TEST(MapSession, AnEmptyMapBecomesWhatTheOtherWas) {
  MapStore store({10, kSessionVoxel});
  Fill(&store);
  const MapSession session = store.Session();
  ASSERT_EQ(session.keyframes.size(), 4u);
  EXPECT_EQ(session.keyframes[2].key.mapper, "b") << "in the order in which they came";
  EXPECT_EQ(session.earlier, 1u);
  EXPECT_EQ(session.keyframes[2].pose.camera_frame, "camera");
  EXPECT_EQ(session.keyframes[2].pose.camera.width, 64);
  for (const double voxel_size : {kSessionVoxel, 0.0}) {
    MapStore loaded({10, voxel_size});
    loaded.Join(session, RigidTransform::Identity());
    EXPECT_TRUE(SameBytes(loaded.WorldCloud().points, store.WorldCloud().points));
    ExpectSamePath(loaded.Path(), store.Path());
    EXPECT_EQ(loaded.statistics().points, store.statistics().points);
    EXPECT_EQ(loaded.statistics().voxel_size, kSessionVoxel);
    EXPECT_GT(loaded.version(), 0u);
  }
}

TEST(MapSession, MappingGoesOnAndLoopClosuresCorrectTheLastRuns) {
  MapStore store({10, kSessionVoxel});
  Fill(&store);
  MapStore loaded({10, kSessionVoxel});
  Add(&loaded, {"old", 1, 0}, 50);
  loaded.Repose({{0, Shifted(60)}});
  loaded.Clear();  // neither its path nor its runs concern what is loaded
  loaded.Join(store.Session(), RigidTransform::Identity());
  ExpectSamePath(loaded.Path(), store.Path());
  for (MapStore* map : {&store, &loaded}) {
    EXPECT_EQ(map->Repose({{0, Shifted(1, 9)}, {kSecond, Shifted(3.2, 9)}}).moved.size(), 3u) << "not the earlier run";
    Add(map, {"a", 2, 2}, 4);
    Add(map, {"c", 1, 0}, 5);
    // Until this a/2/2 lies in the two maps as it was received, moved by what its neighbours were moved by.
    map->Repose({{0, Shifted(1, 9)}, {kSecond, Shifted(3.2, 9)}, {2 * kSecond, Shifted(5, 9)}});
  }
  const auto expected = store.Path(), path = loaded.Path();
  ASSERT_EQ(path.size(), 6u);
  for (size_t i = 0; i < 6; ++i) {  // rounding: corrections start from what was saved, not from what was received
    EXPECT_TRUE(path[i].pose.isApprox(expected[i].pose, 1e-12)) << i;
  }
  EXPECT_EQ(loaded.statistics().keyframes, 6u);
  EXPECT_FALSE(loaded.Add({"b", 5, 1}, PoseAt(1, Shifted(0)), Wall())) << "it was loaded";
  EXPECT_TRUE(loaded.Replace({"b", 5, 1}, {}, Wall(5)));
}

TEST(MapSession, ASecondOneIsPutWhereItIsTold) {
  MapStore first({10, kSessionVoxel}), second({10, kSessionVoxel});
  Add(&first, {"a", 1, 0}, 0);
  Add(&second, {"a", 2, 0}, 1);
  Add(&second, {"b", 1, 0}, 2);
  const RigidTransform world_from_session = Shifted(10, -4);
  first.Join(second.Session(), world_from_session);
  const auto path = first.Path();
  ASSERT_EQ(path.size(), 3u);
  EXPECT_EQ(path[1].pose.matrix(), (world_from_session * Shifted(1)).matrix());
  EXPECT_EQ(path[2].pose.matrix(), (world_from_session * Shifted(2)).matrix());
  EXPECT_EQ(first.Repose({{0, Shifted(0, 1)}}).moved, std::vector<size_t>{0}) << "of another frontend's start";
  EXPECT_EQ(first.Path()[1].pose.matrix(), path[1].pose.matrix());
  Add(&first, {"a", 1, 1}, 3);
  EXPECT_EQ(first.Path()[1].pose.translation().y(), first.Path()[0].pose.translation().y())
      << "the run of before goes on, and its path holds";
  // It stays so when all is saved and loaded, whichever keyframes came last.
  MapStore both({10, kSessionVoxel});
  first.Join(
      [] {
        MapStore third({10, kSessionVoxel});
        Add(&third, {"a", 3, 0}, 6);
        return third.Session();
      }(),
      RigidTransform::Identity());
  both.Join(first.Session(), RigidTransform::Identity());
  ExpectSamePath(both.Path(), first.Path());
  EXPECT_EQ(both.Repose({{0, Shifted(0, 2)}, {kSecond, Shifted(3, 2)}}).moved.size(), 2u);
  EXPECT_EQ(both.Path()[0].pose.translation().y(), 2);
  EXPECT_EQ(both.Path()[2].pose.matrix(), first.Path()[2].pose.matrix());
}

TEST(MapSession, StaysWhenAMapperStartsAnew) {
  MapStore store({10, kSessionVoxel, 0, true}), saved({10, kSessionVoxel});
  Add(&saved, {"a", 1, 0}, 0);
  store.Join(saved.Session(), RigidTransform::Identity());
  Add(&store, {"a", 2, 0}, 1);
  Add(&store, {"a", 3, 0}, 2);
  EXPECT_EQ(store.statistics().keyframes, 2u);
  EXPECT_EQ(store.statistics().evicted_by_run, 1u);
}

TEST(MapSession, PointsAreThinnedToTheMapsVoxels) {
  MapStore store({10, kSessionVoxel}), coarse({10, 3 * kSessionVoxel});
  Add(&store, {"a", 1, 0}, 0);
  coarse.Join(store.Session(), RigidTransform::Identity());
  EXPECT_LT(coarse.statistics().points, store.statistics().points / 4);
  EXPECT_EQ(coarse.statistics().voxel_size, 3 * kSessionVoxel);
}

TEST(MapSession, AllOrNothing) {
  MapStore saved({10, kSessionVoxel}), store({4, kSessionVoxel});
  Add(&saved, {"a", 1, 7}, 0);
  Add(&saved, {"a", 1, 8}, 1);
  Add(&store, {"a", 1, 8}, 5);
  const PointCloud before = store.WorldCloud().points;
  const uint64_t version = store.version();
  const MapSession session = saved.Session();
  const auto refusal = [&](const std::function<void(MapSession*)>& change) {
    MapSession bad = session;
    bad.keyframes[1].key.id = 9;
    change(&bad);
    return ErrorOf([&] { store.Join(bad, RigidTransform::Identity()); });
  };
  const auto replace = [](SessionKeyframe* keyframe, const std::function<void(PointCloud*)>& change) {
    PointCloud points = keyframe->points_in_camera->Unpack();
    change(&points);
    keyframe->points_in_camera = std::make_shared<const PackedCloud>(points);
  };
  EXPECT_THAT(refusal([](auto* s) { s->keyframes[1].key.id = 8; }),
              HasAll("keyframe 8 of \"a\", run 1", "in the map already", "reset"));
  EXPECT_THAT(refusal([](auto* s) { s->keyframes[1].key.id = 7; }),
              HasSubstr("keyframe 7 of \"a\", run 1 comes twice"));
  EXPECT_THAT(refusal([&](auto* s) {
                replace(&s->keyframes[1], [](auto* points) { points->at(3).position.y = std::nanf(""); });
              }),
              HasAll("keyframe 9", "point 3", "must be finite"));
  EXPECT_THAT(refusal([](auto* s) {
                for (uint64_t id = 20; id < 22; ++id) {
                  s->keyframes.push_back(s->keyframes[0]);
                  s->keyframes.back().key.id = id;
                  s->keyframes.back().pose.stamp_ns = static_cast<int64_t>(id);
                }
              }),
              HasAll("4 keyframes, and 1 are in the map", "max_keyframes = 4"));
  EXPECT_EQ(store.version(), version);
  EXPECT_TRUE(SameBytes(store.WorldCloud().points, before));
  EXPECT_EQ(refusal([](auto*) {}), "no error");
}

}  // namespace
}  // namespace acmp::test
