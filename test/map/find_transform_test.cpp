#include "acmp_mapping/map/find_transform.h"

#include <random>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

std::vector<SyntheticView> Views(SyntheticPlace place) {
  SyntheticSceneOptions options;
  options.width = 240;
  options.height = 180;
  options.keyframes = 18;
  options.place = place;
  return MakeSyntheticScene(options);
}

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
    PointCloud points;
    const PinholeCamera& camera = views[i].frame.camera;
    for (int row = 0; row < camera.height; ++row) {
      for (int col = 0; col < camera.width; ++col) {
        double depth = views[i].true_depth(col, row);
        if (!(depth > 0)) continue;
        depth *= 1 + 0.003 * (static_cast<double>(random() % 2001) / 1000 - 1);
        const Eigen::Vector3f p = camera.Unproject({col, row}, depth).cast<float>();
        points.push_back({{p.x(), p.y(), p.z()}, views[i].true_normal(col, row), views[i].frame.color(col, row), 0.9f});
      }
    }
    KeyframePose pose;
    pose.stamp_ns = static_cast<int64_t>(i);
    pose.world_from_cam = own_from_true * views[i].frame.cam_from_world.inverse();
    pose.camera = camera;
    store.Add({Concat("of ", begin), 1, i}, pose, points);
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
  EXPECT_THAT(ErrorOf([&] { FindTransform(RoomMap(), street); }), HasSubstr("no place was found"));
  EXPECT_THAT(ErrorOf([&] { FindTransform(street, RoomMap()); }), HasSubstr("no place was found"));
  EXPECT_THAT(ErrorOf([&] { FindTransform({}, RoomMap()); }), HasSubstr("at most 0 matches support one"));
  MapSession one_point = MapOf(RoomViews(), 0, 1, RigidTransform::Identity());
  const SurfacePoint point = one_point.keyframes[0].points_in_camera->front();
  one_point.keyframes[0].points_in_camera = std::make_shared<const PointCloud>(PointCloud{point});
  EXPECT_THAT(ErrorOf([&] { FindTransform(RoomMap(), one_point); }), HasSubstr("at most 0 matches support one"));
}

/// Two rooms that are alike.
TEST(FindTransformTest, WhatMayLieAtTwoPlacesIsRefused) {
  MapSession map = RoomMap();
  const MapSession twin = MapOf(RoomViews(), 0, 10, OtherWorld());
  map.keyframes.insert(map.keyframes.end(), twin.keyframes.begin(), twin.keyframes.end());
  EXPECT_THAT(ErrorOf([&] { FindTransform(map, OtherRoomMap()); }), HasSubstr("it may lie at more than one place: "));
}

/// Two starts of a monocular frontend.
TEST(FindTransformTest, AnotherScaleIsRefused) {
  MapSession half = OtherRoomMap();
  half.voxel_size /= 2;
  for (SessionKeyframe& keyframe : half.keyframes) {
    keyframe.pose.world_from_cam.translation() /= 2;
    PointCloud points = *keyframe.points_in_camera;
    for (SurfacePoint& point : points) point.position = 0.5f * point.position;
    keyframe.points_in_camera = std::make_shared<const PointCloud>(points);
  }
  EXPECT_THAT(ErrorOf([&] { FindTransform(RoomMap(), half); }), HasSubstr("times as large: must be of the same scale"));
}

TEST(FindTransformTest, EndsWhereItIsToldTo) {
  const auto stop = [] { throw std::runtime_error("the map server is shutting down"); };
  EXPECT_THROW(FindTransform(RoomMap(), OtherRoomMap(), stop), std::runtime_error);
}

}  // namespace
}  // namespace acmp
