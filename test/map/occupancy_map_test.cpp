#include "acmp_mapping/map/occupancy_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "map/room_keyframes.h"
#include "support/error_text.h"

namespace acmp {
namespace {

/// Looks along x from (0, 0, 1), so that y of the image is down.
PlacedKeyframe Keyframe(const PointCloud& points) {
  PlacedKeyframe keyframe;
  keyframe.world_from_cam.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  keyframe.world_from_cam.translation() << 0, 0, 1;
  keyframe.points_in_camera = std::make_shared<const PackedCloud>(points);
  return keyframe;
}

PointCloud Wall(float depth) {
  PointCloud points;
  for (float x = -0.975f; x < 1; x += 0.02f) {
    for (float y = -0.975f; y < 1; y += 0.02f) points.push_back({{x, y, depth}, {0, 0, -1}, {}, 0, 0.9f});
  }
  return points;
}

/// Of the cell at x and y.
Occupancy At(const OccupancySlice& slice, double x, double y) {
  const double col = std::floor((x - slice.origin_x) / slice.resolution);
  const double row = std::floor((y - slice.origin_y) / slice.resolution);
  if (!(col >= 0 && col < slice.width && row >= 0 && row < slice.height)) return Occupancy::kUnknown;
  return slice.cells.at(static_cast<size_t>(row) * static_cast<size_t>(slice.width) + static_cast<size_t>(col));
}

/// Of the voxel at a point in the world.
Occupancy At(const OccupancyMap& map, const Eigen::Vector3d& point) {
  const double bottom = std::floor(point.z() / map.resolution()) * map.resolution();
  return At(map.Slice(bottom, bottom + map.resolution()), point.x(), point.y());
}

/// Of a camera in a world, after turning it in place about its own axes (degrees).
PlacedKeyframe Turned(const Eigen::Matrix3d& world_from_cam, double pitch_up, double roll, double yaw) {
  PlacedKeyframe keyframe;
  const auto turn = [](double degrees, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(degrees * M_PI / 180, axis);
  };
  keyframe.world_from_cam.linear() =
      world_from_cam * (turn(yaw, Eigen::Vector3d::UnitY()) * turn(pitch_up, Eigen::Vector3d::UnitX()) *
                        turn(roll, Eigen::Vector3d::UnitZ()))
                           .toRotationMatrix();
  return keyframe;
}

TEST(OccupancyMapTest, RaysGoThroughWhatIsNoObstacle) {
  constexpr Label kGrass = 7;
  PointCloud grass = Wall(1), wall = Wall(2);
  for (SurfacePoint& point : grass) point.label = kGrass;
  OccupancyLimits limits;
  limits.passable = {kGrass};
  const Eigen::Vector3d in_grass(1.02, 0.02, 1.02);
  for (const bool passable : {false, true}) {
    OccupancyMap map(0.05, passable ? limits : OccupancyLimits());
    ASSERT_TRUE(map.Insert({Keyframe(grass)}));
    EXPECT_EQ(At(map, in_grass), passable ? Occupancy::kFree : Occupancy::kOccupied);
    EXPECT_EQ(At(map, {0.5, 0.02, 1.02}), Occupancy::kFree);
  }
  PointCloud mixed = grass;  // where one point is an obstacle its voxel is, whatever else is there
  mixed.insert(mixed.end(), wall.begin(), wall.end());
  SurfacePoint post = grass.front();
  post.position = {0, 0, 1.01f};
  post.label = 0;
  mixed.push_back(post);
  OccupancyMap map(0.05, limits);
  ASSERT_TRUE(map.Insert({Keyframe(mixed)}));
  EXPECT_EQ(At(map, {1.02, -0.02, 0.98}), Occupancy::kFree);
  EXPECT_EQ(At(map, Keyframe({}).world_from_cam * Eigen::Vector3d(0, 0, 1.01)), Occupancy::kOccupied);
  map.Remove(Keyframe(mixed));
  EXPECT_EQ(map.voxels(), 0u);
}

TEST(OccupancyMapTest, CamerasTellWhetherZPointsUp) {
  const Eigen::Matrix3d z_up = Keyframe({}).world_from_cam.linear();
  const Eigen::Matrix3d z_forward = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d z_down = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()) * z_up;
  for (const double yaw_step : {0.0, 30.0}) {  // one that looks ahead, one that turns all around
    const auto says = [&](const Eigen::Matrix3d& world_from_cam, double pitch_up, double roll = 0) {
      std::vector<PlacedKeyframe> keyframes;
      for (int i = 0; i < 12; ++i) {
        keyframes.push_back(Turned(world_from_cam, pitch_up + 5 * (i % 3 - 1), roll + 7 * (i % 2), yaw_step * i));
        keyframes.back().stamp_ns = i;
      }
      return ZPointsUp(keyframes);
    };
    for (const double pitch : {-85.0, -45.0, 0.0, 45.0}) EXPECT_TRUE(says(z_up, pitch)) << pitch << ", " << yaw_step;
    EXPECT_FALSE(says(z_up, 0, 90)) << "mounted on its side";
    for (const double pitch : {-20.0, 0.0, 20.0}) EXPECT_FALSE(says(z_forward, pitch)) << pitch << ", " << yaw_step;
    for (const double pitch : {-85.0, 0.0, 45.0}) EXPECT_FALSE(says(z_down, pitch)) << pitch << ", " << yaw_step;
  }
  std::vector<PlacedKeyframe> faces = {Turned(z_up, 0, 0, 0), Turned(z_up, 90, 0, 0), Turned(z_up, -90, 0, 0)};
  EXPECT_TRUE(ZPointsUp(faces)) << "of one capture, the face ahead";
}

TEST(OccupancyMapTest, RaysAreFreeEndsAreOccupiedTheRestIsUnknown) {
  OccupancyMap map(0.05);
  map.Insert({Keyframe(Wall(2.02f))});
  EXPECT_EQ(At(map, {1, 0, 1}), Occupancy::kFree);
  EXPECT_EQ(At(map, {1.9, 0.8, 1.8}), Occupancy::kFree);
  EXPECT_EQ(At(map, {2.02, 0, 1}), Occupancy::kOccupied);
  EXPECT_EQ(At(map, {2.3, 0, 1}), Occupancy::kUnknown) << "behind the wall";
  EXPECT_EQ(At(map, {1, 0.9, 1}), Occupancy::kUnknown) << "out of view";
  EXPECT_EQ(At(map, {1e9, 0, 0}), Occupancy::kUnknown);
}

TEST(OccupancyMapTest, DoubtfulPointsSayNothing) {
  PointCloud points = Wall(2);
  for (SurfacePoint& point : points) point.confidence = 0.9f * kMinOccupancyConfidence;
  OccupancyMap map(0.05);
  map.Insert({Keyframe(points)});
  EXPECT_EQ(map.voxels(), 0u);
  EXPECT_TRUE(map.Slice(0, 1).cells.empty());
}

TEST(OccupancyMapTest, ScaledKeyframesLieWhereTheMapHasThem) {
  PlacedKeyframe keyframe = Keyframe(Wall(1.01f));
  keyframe.scale = 2;
  OccupancyMap map(0.05);
  map.Insert({keyframe});
  EXPECT_EQ(At(map, {2.02, 0, 1}), Occupancy::kOccupied);
}

TEST(OccupancyMapTest, SliceIsSeenFromAbove) {
  OccupancyMap map(0.05);
  map.Insert({Keyframe(Wall(2.02f))});
  const OccupancySlice slice = map.Slice(0.9, 1.1);
  ASSERT_EQ(slice.cells.size(), static_cast<size_t>(slice.width * slice.height));
  EXPECT_EQ(slice.resolution, 0.05);
  EXPECT_EQ(At(slice, 1.5, 0), Occupancy::kFree);
  EXPECT_EQ(At(slice, 2.02, 0.5), Occupancy::kOccupied);
  EXPECT_EQ(At(slice, 2.02, -0.5), Occupancy::kOccupied);
  EXPECT_EQ(At(slice, 0.5, 0.9), Occupancy::kUnknown) << "out of view";
  const OccupancySlice high = map.Slice(0.9, 2.4);  // above 2 nothing was seen
  const size_t free = static_cast<size_t>(std::count(high.cells.begin(), high.cells.end(), Occupancy::kFree));
  EXPECT_EQ(free, 0u) << "a column is free if all of it is";
  EXPECT_TRUE(map.Slice(5, 6).cells.empty());
  EXPECT_REFUSED(map.Slice(1, 1), "must be below");
}

TEST(OccupancyMapTest, CellsOfTheRoomAreAsTheTrueGeometrySays) {
  constexpr double kResolution = 0.05, kLow = 0.2, kHigh = 0.6;
  const std::vector<SyntheticView> views = MakeSyntheticScene({160, 120});
  const auto map = MakeOccupancyMap(test::RoomKeyframes(views, 0.02), kResolution);
  const OccupancySlice slice = map->Slice(kLow, kHigh);
  // How far the middle of each cell is from true surfaces between the heights, where they are near.
  const auto middle_of = [&](int col, int row) {
    return Eigen::Vector2d(slice.origin_x + (col + 0.5) * kResolution, slice.origin_y + (row + 0.5) * kResolution);
  };
  Image<double> nearest(slice.width, slice.height, 1e9);
  for (const SurfacePoint& point : SampleSyntheticSurface(views, 0.02f)) {
    if (point.position.z <= kLow || point.position.z >= kHigh) continue;
    const Eigen::Vector2d at(point.position.x, point.position.y);
    const int col = static_cast<int>(std::floor((at.x() - slice.origin_x) / kResolution));
    const int row = static_cast<int>(std::floor((at.y() - slice.origin_y) / kResolution));
    for (int v = std::max(0, row - 2); v <= std::min(row + 2, slice.height - 1); ++v) {
      for (int u = std::max(0, col - 2); u <= std::min(col + 2, slice.width - 1); ++u) {
        nearest(u, v) = std::min(nearest(u, v), (at - middle_of(u, v)).norm());
      }
    }
  }
  int free = 0, at_surface = 0, occupied = 0;
  for (size_t i = 0; i < nearest.size(); ++i) {
    const double distance = nearest.data()[i];
    free += slice.cells[i] == Occupancy::kFree;
    at_surface += slice.cells[i] == Occupancy::kFree && distance < 0.2 * kResolution;
    occupied += slice.cells[i] == Occupancy::kOccupied;
    if (slice.cells[i] == Occupancy::kOccupied) {
      EXPECT_LT(distance, 1.5 * kResolution) << "cell " << i;
    }
  }
  EXPECT_LT(at_surface, 0.01 * free) << "of boxes that are seen along their sides";
  EXPECT_GT(free, 1000);
  EXPECT_GT(occupied, 100);
  EXPECT_EQ(At(*map, {3.5, 0, 0.4}), Occupancy::kUnknown) << "outside of the room";
}

TEST(OccupancyMapTest, WhatIsBeyondOctoMapsReachGetsLargerVoxels) {
  const PlacedKeyframe near = Keyframe(Wall(2.02f));
  PlacedKeyframe far = near;
  far.world_from_cam.translation().x() = 5000;
  EXPECT_FALSE(OccupancyMap(0.05).Insert({near, far})) << "1600 at most";
  EXPECT_FALSE(OccupancyMap(0.05).Insert({Keyframe({{{0, 0, 5000}, {0, 0, -1}, {}, 0, 1}})}));
  const auto map = MakeOccupancyMap({{near, far}, 0.0125}, 0);
  EXPECT_EQ(map->resolution(), 0.2);
  EXPECT_EQ(At(*map, {1, 0, 1}), Occupancy::kFree);
  EXPECT_EQ(At(*map, {2.02, 0, 1}), Occupancy::kOccupied);
  EXPECT_EQ(At(*map, {5002.02, 0, 1}), Occupancy::kOccupied);
}

TEST(OccupancyMapTest, CostIsBoundedByLargerVoxels) {
  const PlacedKeyframes map = {{Keyframe(Wall(2.02f))}, 0.0125};
  const auto resolution_with = [&](const OccupancyLimits& limits) {
    return MakeOccupancyMap(map, 0.05, limits)->resolution();
  };
  EXPECT_EQ(resolution_with({}), 0.05);
  OccupancyLimits memory;
  const size_t voxels = MakeOccupancyMap(map, 0.05)->voxels();
  memory.max_bytes = voxels * 64 / 3 * 4 - 1000;
  EXPECT_EQ(resolution_with(memory), 0.1) << "of the voxels, as OctoMap has them";
  PlacedKeyframes again = map;  // as many rays more often: the same voxels
  again.keyframes.insert(again.keyframes.end(), 3, map.keyframes[0]);
  EXPECT_EQ(MakeOccupancyMap(again, 0.05)->voxels(), voxels);
  OccupancyLimits stopped;
  stopped.check = [] { throw InvalidInputError("stopped"); };
  EXPECT_EQ(ErrorOf([&] { resolution_with(stopped); }), "stopped");
}

TEST(OccupancyMapTest, AWideSceneGetsAsManyCellsAsThereMayBe) {
  PlacedKeyframes map = {{Keyframe(Wall(2.02f)), Keyframe(Wall(2.02f))}, 0.0125};
  map.keyframes[1].world_from_cam.translation() += Eigen::Vector3d(300, 300, 0);  // 6000 x 6000 cells of 5 cm
  OccupancyLimits limits;
  limits.max_bytes = 10000000 * 16;
  const auto occupancy = MakeOccupancyMap(map, 0, limits);
  EXPECT_EQ(occupancy->resolution(), 0.1);
  EXPECT_LT(occupancy->Slice(0.9, 1.1).cells.size(), 10000000u);
}

/// Whether two maps say the same of all voxels.
void ExpectSame(const OccupancyMap& a, const OccupancyMap& b) {
  ASSERT_EQ(a.voxels(), b.voxels());
  const VoxelBox box = a.KnownBox();
  ASSERT_EQ(box.low, b.KnownBox().low);
  ASSERT_EQ(box.high, b.KnownBox().high);
  std::vector<Occupancy> of_a, of_b;
  a.Read(box, &of_a);
  b.Read(box, &of_b);
  EXPECT_EQ(of_a, of_b);
}

TEST(LiveOccupancyTest, IsWhatIsMadeAtOnceWhateverHasChanged) {
  PlacedKeyframes all = test::RoomKeyframes(MakeSyntheticScene({80, 60}), 0.02);
  for (size_t i = 0; i < all.keyframes.size(); ++i) all.keyframes[i].key.id = i;
  PlacedKeyframes map = all;
  map.keyframes.resize(2);
  LiveOccupancy live{{}};
  EXPECT_TRUE(live.Update(map).anew);
  const auto follow = [&](const char* what) {
    SCOPED_TRACE(what);
    const LiveOccupancy::Change change = live.Update(map);
    EXPECT_FALSE(change.anew);
    EXPECT_FALSE(change.changed.empty());
    ExpectSame(*live.map(), *MakeOccupancyMap(map, 0));
  };
  map = all;
  follow("new keyframes");
  map.keyframes[1].world_from_cam.translation().x() += 0.3;
  follow("one that has moved");
  map.keyframes[3].points_in_camera = all.keyframes[0].points_in_camera;
  follow("other points");
  map.keyframes.erase(map.keyframes.begin());
  follow("one that has gone");
  map.keyframes[1].world_from_cam.translation().x() += 1e-3;
  EXPECT_TRUE(live.Update(map).changed.empty()) << "less than kMovedVoxels";
  map.origin.x() = 100;
  EXPECT_TRUE(live.Update(map).anew);
  map.keyframes.clear();
  EXPECT_TRUE(live.Update(map).anew);
  EXPECT_EQ(live.map(), nullptr);
}

TEST(LiveOccupancyTest, GetsLargerVoxelsWhereItGrowsTooLarge) {
  PlacedKeyframes map = {{Keyframe(Wall(2.02f))}, 0.0125};
  OccupancyLimits limits;
  limits.max_bytes = 40000 * 64 / 3 * 4;
  LiveOccupancy live(limits);
  live.Update(map);
  EXPECT_EQ(live.map()->resolution(), 0.05);
  for (uint64_t id = 1; id < 4; ++id) {
    map.keyframes.push_back(map.keyframes[0]);
    map.keyframes.back().key.id = id;
    map.keyframes.back().world_from_cam.translation().x() += 3 * static_cast<double>(id);
  }
  EXPECT_TRUE(live.Update(map).anew);
  EXPECT_EQ(live.map()->resolution(), 0.1);
  ExpectSame(*live.map(), *MakeOccupancyMap(map, 0.1));
}

}  // namespace
}  // namespace acmp
