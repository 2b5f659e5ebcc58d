#include "acmp_mapping/map/distance_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "map/room_keyframes.h"

namespace acmp {
namespace {

/// Squared distance in voxels to the nearest obstacle of a grid, at most kMaxDistanceVoxels^2.
class NearestObstacle {
 public:
  NearestObstacle(const DistanceGrid& grid, bool unknown_is_obstacle) {
    VoxelIndex v;
    for (v[2] = grid.box.low[2]; v[2] <= grid.box.high[2]; ++v[2]) {
      for (v[1] = grid.box.low[1]; v[1] <= grid.box.high[1]; ++v[1]) {
        for (v[0] = grid.box.low[0]; v[0] <= grid.box.high[0]; ++v[0]) {
          const Occupancy occupancy = grid.OccupancyAt(grid.CellOf(v));
          if (occupancy == Occupancy::kOccupied || (unknown_is_obstacle && occupancy == Occupancy::kUnknown))
            obstacles_.push_back(v);
        }
      }
    }
  }
  double At(const VoxelIndex& voxel) const {
    int64_t nearest = kMaxDistanceVoxels * kMaxDistanceVoxels;
    for (const VoxelIndex& obstacle : obstacles_) {
      int64_t squared = 0;
      for (size_t i = 0; i < 3; ++i) squared += int64_t{obstacle[i] - voxel[i]} * (obstacle[i] - voxel[i]);
      nearest = std::min(nearest, squared);
    }
    return std::sqrt(static_cast<double>(nearest));
  }

 private:
  std::vector<VoxelIndex> obstacles_;
};

/// Of some voxels all over the grid.
void ExpectDistances(const DistanceGrid& grid, bool unknown_is_obstacle) {
  const NearestObstacle nearest(grid, unknown_is_obstacle);
  constexpr size_t kEvery = 97;  // a prime
  size_t count = 0;
  const size_t cells = grid.size(0) * grid.size(1) * grid.size(2);
  for (size_t cell = 0; cell < cells; cell += kEvery) {
    const auto at = [&](size_t i, size_t along) { return grid.box.low[i] + static_cast<int>(along % grid.size(i)); };
    const VoxelIndex voxel = {at(0, cell / grid.size(1) / grid.size(2)), at(1, cell / grid.size(2)), at(2, cell)};
    ASSERT_EQ(grid.CellOf(voxel), cell);
    const double distance = grid.DistanceAt(cell) / grid.resolution;
    EXPECT_NEAR(distance, nearest.At(voxel), 1e-5) << cell;  // float32
    ++count;
  }
  EXPECT_GT(count, 1000u);
}

class DistanceFieldTest : public ::testing::TestWithParam<bool> {
 protected:
  DistanceFieldTest() {
    all_ = test::RoomKeyframes(MakeSyntheticScene({80, 60}), 0.025);
    for (size_t i = 0; i < all_.keyframes.size(); ++i) all_.keyframes[i].key.id = i;
  }
  VoxelBox Follow(const PlacedKeyframes& map, DistanceField* field) {
    const LiveOccupancy::Change change = live_.Update(map);
    return field->Update(live_, change, map.keyframes.back().world_from_cam.translation(), ++version_);
  }
  PlacedKeyframes all_;
  LiveOccupancy live_{{}};
  uint64_t version_ = 0;
};

TEST_P(DistanceFieldTest, IsTheDistanceToTheNearestObstacleWhateverHasChanged) {
  DistanceField field(GetParam(), 1000000000);
  PlacedKeyframes map = all_;
  map.keyframes.pop_back();
  EXPECT_FALSE(Follow(map, &field).empty());
  ExpectDistances(*field.grid(), GetParam());
  const auto before = field.grid();
  map = all_;
  map.keyframes[0].world_from_cam.translation().y() += 0.3;
  map.keyframes.erase(map.keyframes.begin() + 1);
  const VoxelBox region = Follow(map, &field);
  const auto& grid = *field.grid();
  EXPECT_EQ(before->version, 1u) << "does not change";
  EXPECT_EQ(grid.version, 2u);
  ExpectDistances(grid, GetParam());
  // What is outside of the region that is told has not changed.
  ASSERT_EQ(before->box.low, grid.box.low);
  size_t changed = 0;
  for (size_t cell = 0; cell < grid.size(0) * grid.size(1) * grid.size(2); ++cell) {
    if (before->DistanceAt(cell) == grid.DistanceAt(cell)) continue;
    ++changed;
    const auto at = [&](size_t i, size_t along) { return grid.box.low[i] + static_cast<int>(along % grid.size(i)); };
    ASSERT_TRUE(region.Contains({at(0, cell / grid.size(1) / grid.size(2)), at(1, cell / grid.size(2)), at(2, cell)}));
  }
  EXPECT_GT(changed, 100u);
}

INSTANTIATE_TEST_SUITE_P(Unknown, DistanceFieldTest, ::testing::Bool());

TEST_F(DistanceFieldTest, PointsAreInterpolatedAndTheGradientIsTheSlope) {
  DistanceField field(false, 1000000000);
  Follow(all_, &field);
  const DistanceGrid& grid = *field.grid();
  size_t steep = 0, count = 0;
  for (double x = -1.5; x < 1.5; x += 0.0837) {
    for (double y = -1.5; y < 1.5; y += 0.0837) {
      const Eigen::Vector3d point(x, y, 1.2345);
      const PointDistance at = grid.At(point);
      if (!(at.distance > 0)) continue;
      ++count;
      steep += at.gradient.norm() > 0.7f && at.gradient.norm() < 1.05f;
      constexpr double kStep = 1e-5;
      const float further = grid.At(point + kStep * Eigen::Vector3d::UnitX()).distance;
      EXPECT_NEAR((further - at.distance) / kStep, at.gradient.x(), 0.05) << x << ", " << y;
    }
  }
  EXPECT_GT(count, 500u);
  EXPECT_GT(steep, count * 8 / 10) << "a distance grows by 1 per 1, but where two obstacles are as near";
  const PointDistance outside = grid.At({1e6, 0, 0});
  EXPECT_TRUE(std::isnan(outside.distance));
  EXPECT_EQ(outside.occupancy, Occupancy::kUnknown);
  EXPECT_TRUE(std::isnan(grid.At({std::nan(""), 0, 0}).distance));
}

TEST_F(DistanceFieldTest, MoreThanTheMemoryHoldsIsABoxAboutTheCamera) {
  constexpr size_t kBytes = 8 * 20000;
  DistanceField field(false, kBytes);
  Follow(all_, &field);
  const DistanceGrid& grid = *field.grid();
  EXPECT_TRUE(grid.cropped());
  EXPECT_LE(grid.size(0) * grid.size(1) * grid.size(2), 20000u);
  EXPECT_FALSE(std::isnan(grid.At(all_.keyframes.back().world_from_cam.translation()).distance));
  const auto before = field.grid();
  all_.keyframes.push_back(all_.keyframes.front());  // far from there
  all_.keyframes.back().key.id = 1000;
  all_.keyframes.back().world_from_cam.translation().x() += 2;
  Follow(all_, &field);
  EXPECT_FALSE(std::isnan(field.grid()->At(all_.keyframes.back().world_from_cam.translation()).distance))
      << "the box follows it";
}

TEST_F(DistanceFieldTest, DistancesInABoxAreAtMostThoseToWhereTheMapGoesOn) {
  DistanceField whole_field(false, 1000000000), field(false, 8 * 20000);
  Follow(all_, &whole_field);
  field.Update(live_, {true, {}}, all_.keyframes.back().world_from_cam.translation(), 1);
  const DistanceGrid &whole = *whole_field.grid(), &grid = *field.grid();
  ASSERT_TRUE(grid.cropped());
  size_t nearer = 0, same = 0;
  VoxelIndex v;
  for (v[0] = grid.box.low[0]; v[0] <= grid.box.high[0]; ++v[0]) {
    for (v[1] = grid.box.low[1]; v[1] <= grid.box.high[1]; ++v[1]) {
      for (v[2] = grid.box.low[2]; v[2] <= grid.box.high[2]; ++v[2]) {
        const float distance = grid.DistanceAt(grid.CellOf(v)), in_all = whole.DistanceAt(whole.CellOf(v));
        int to_side = kMaxDistanceVoxels;
        for (size_t i = 0; i < 3; ++i) {
          if (grid.goes_on_below[i]) to_side = std::min(to_side, v[i] - grid.box.low[i] + 1);
          if (grid.goes_on_above[i]) to_side = std::min(to_side, grid.box.high[i] - v[i] + 1);
        }
        ASSERT_LE(distance, in_all) << "an obstacle beyond the box is nearer than is told";
        ASSERT_NEAR(distance, std::min<double>(in_all, grid.resolution * to_side), 1e-5);  // float32
        ++(distance < in_all ? nearer : same);
      }
    }
  }
  EXPECT_GT(nearer, 100u);
  EXPECT_GT(same, 1000u);
  // What lies beyond goes: distances are as far again as the box's own obstacles.
  PlacedKeyframes newest = all_;
  newest.keyframes.erase(newest.keyframes.begin(), newest.keyframes.end() - 1);
  DistanceField again(false, 1000000000);
  Follow(newest, &again);
  EXPECT_FALSE(again.grid()->cropped());
}

}  // namespace
}  // namespace acmp
