#include "acmp_mapping/map/find_transform.h"

#include <random>
#include <vector>

#include "gtest/gtest.h"

#include "map/room_keyframes.h"
#include "support/error_text.h"

namespace acmp {
namespace {

std::vector<SyntheticView> Views(SyntheticPlace place) { return MakeSyntheticScene({240, 180, 18, 1, place}); }

const std::vector<SyntheticView>& RoomViews() {
  static const std::vector<SyntheticView> views = Views(SyntheticPlace::kRoom);
  return views;
}

/// The map of some views, in a world of its own; depths have an error of 0.3 %.
MapSession MapOf(const std::vector<SyntheticView>& views, size_t begin, size_t end,
                 const RigidTransform& own_from_true) {
  MapStore store({100, 0});
  std::minstd_rand random(static_cast<unsigned>(begin) + 1);
  for (size_t i = begin; i < end; ++i) {
    const auto with_error = [&] { return 1 + 0.003 * (static_cast<double>(random() % 2001) / 1000 - 1); };
    KeyframePose pose;
    pose.stamp_ns = static_cast<int64_t>(i);
    pose.world_from_capture = own_from_true * views[i].frame.cam_from_world.inverse();
    pose.camera = views[i].frame.camera;
    store.Add({Concat("of ", begin), 1, i}, pose, test::PointsOf(views[i], with_error));
  }
  return store.Session();
}

RigidTransform OtherWorld() {
  RigidTransform transform = RigidTransform::Identity();
  transform.linear() = Eigen::AngleAxisd(2.1, Eigen::Vector3d(0.2, 0.1, 1).normalized()).toRotationMatrix();
  transform.translation() << 5, -3, 1;
  return transform;
}

MapSession RoomMap() { return MapOf(RoomViews(), 0, 10, RigidTransform::Identity()); }
MapSession OtherRoomMap() { return MapOf(RoomViews(), 8, 18, OtherWorld().inverse()); }

TEST(FindTransformTest, TwoStartsInOneRoom) {
  const FoundTransform found = FindTransform(RoomMap(), OtherRoomMap());
  const RigidTransform error = found.map_from_session * OtherWorld().inverse();
  EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.01);
  // About a voxel (0.5 % of the median depth), which the points are thinned to.
  const Eigen::Vector3d middle = RoomViews()[13].frame.cam_from_world.inverse() * Eigen::Vector3d(0, 0, 2);
  EXPECT_LT((error * middle - middle).norm(), 0.03);
  EXPECT_GT(found.agreement, 0.9);
  EXPECT_GT(found.overlap, 0.2);
}

TEST(FindTransformTest, AnotherPlaceIsRefused) {
  const MapSession street = MapOf(Views(SyntheticPlace::kStreet), 0, 10, RigidTransform::Identity());
  EXPECT_REFUSED(FindTransform(RoomMap(), street), "no place was found");
  EXPECT_REFUSED(FindTransform(street, RoomMap()), "no place was found");
  EXPECT_REFUSED(FindTransform({}, RoomMap()), "at most 0 matches support one");
  MapSession one_point = MapOf(RoomViews(), 0, 1, RigidTransform::Identity());
  const SurfacePoint point = one_point.keyframes[0].points_in_camera->Unpack().front();
  one_point.keyframes[0].points_in_camera = std::make_shared<const PackedCloud>(PointCloud{point});
  EXPECT_REFUSED(FindTransform(RoomMap(), one_point), "at most 0 matches support one");
}

/// Two rooms that are alike.
TEST(FindTransformTest, WhatMayLieAtTwoPlacesIsRefused) {
  MapSession map = RoomMap();
  const MapSession twin = MapOf(RoomViews(), 0, 10, OtherWorld());
  map.keyframes.insert(map.keyframes.end(), twin.keyframes.begin(), twin.keyframes.end());
  EXPECT_REFUSED(FindTransform(map, OtherRoomMap()), "it may lie at more than one place: ");
}

/// Of two rooms that are alike one was seen ten times as often.
TEST(FindTransformTest, APlaceThatWasSeenLessMayBeTheRightOne) {
  MapSession map = RoomMap();
  const MapSession twin = MapOf(RoomViews(), 8, 18, OtherWorld());
  for (uint64_t again = 0; again < 10; ++again) {
    for (SessionKeyframe keyframe : RoomMap().keyframes) {
      keyframe.key.run = 2 + again;
      map.keyframes.push_back(std::move(keyframe));
    }
  }
  map.keyframes.push_back(twin.keyframes[2]);
  map.keyframes.push_back(twin.keyframes[3]);
  const MapSession session = MapOf(RoomViews(), 6, 12, OtherWorld().inverse());
  EXPECT_REFUSED(FindTransform(map, session), "it may lie at more than one place: ");
  map.keyframes.resize(map.keyframes.size() - 2);
  EXPECT_GT(FindTransform(map, session).agreement, 0.9);
}

/// Two starts of a monocular frontend.
TEST(FindTransformTest, AnotherScaleIsRefused) {
  MapSession half = OtherRoomMap();
  half.voxel_size /= 2;
  for (SessionKeyframe& keyframe : half.keyframes) {
    keyframe.pose.world_from_capture.translation() /= 2;
    PointCloud points = keyframe.points_in_camera->Unpack();
    for (SurfacePoint& point : points) point.position = 0.5f * point.position;
    keyframe.points_in_camera = std::make_shared<const PackedCloud>(points);
  }
  EXPECT_REFUSED(FindTransform(RoomMap(), half), "times as large: must be of the same scale");
}

TEST(FindTransformTest, EndsWhereItIsToldTo) {
  const auto stop = [] { throw std::runtime_error("the map server is shutting down"); };
  EXPECT_THROW(FindTransform(RoomMap(), OtherRoomMap(), stop), std::runtime_error);
}

}  // namespace
}  // namespace acmp
