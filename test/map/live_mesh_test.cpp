// The mesh while the map grows: when all is told, it is the saved one.

#include "acmp_mapping/map/live_mesh.h"

#include <array>
#include <map>

#include "acmp_mapping/map/map_mesh.h"
#include "map/room_keyframes.h"

namespace acmp::test {
namespace {

constexpr double kRoomVoxel = 0.0207;
constexpr size_t kMuch = 2000000000;
constexpr int kViews = 6;

/// What a listener has.
struct ToldMesh {
  bool hears_all = true;
  std::map<int, TriangleMesh> blocks;
  size_t gone = 0;     ///< blocks
  size_t largest = 0;  ///< update, triangles; of those with more than one block

  void Take(MeshUpdate update) {
    if (update.anew) blocks.clear();
    size_t triangles = 0;
    for (MeshUpdate::Block& block : update.blocks) {
      triangles += block.mesh.triangles.size();
      if (!block.mesh.triangles.empty()) {
        blocks[block.number] = std::move(block.mesh);
      } else {
        EXPECT_GE(blocks.erase(block.number), hears_all ? 1u : 0u) << "what was never told cannot go";
        ++gone;
      }
    }
    if (update.blocks.size() > 1) largest = std::max(largest, triangles);
  }
  size_t triangles() const {
    size_t sum = 0;
    for (const auto& [number, mesh] : blocks) sum += mesh.triangles.size();
    return sum;
  }
};

class LiveMeshTest : public ::testing::Test {
 protected:
  static const std::vector<SyntheticView>& Views() {
    static const std::vector<SyntheticView> views = MakeSyntheticScene({160, 120, kViews});
    return views;
  }
  /// Moved a little: the floor at 0 would lie in the middle of voxels, where the last bits of distances decide how
  /// triangles are cut.
  static const PlacedKeyframe& KeyframeOf(size_t i) {
    static const PlacedKeyframes keyframes = [] {
      PlacedKeyframes moved = RoomKeyframes(Views(), kRoomVoxel);
      for (PlacedKeyframe& keyframe : moved.keyframes) {
        keyframe.world_from_cam.translation() += 0.3 * kRoomVoxel * Eigen::Vector3d::Ones();
      }
      return moved;
    }();
    return keyframes.keyframes[i % kViews];
  }
  static int64_t StampOf(size_t i) { return static_cast<int64_t>(i) * 1000000000; }

  void Add(size_t i) {
    const PlacedKeyframe& keyframe = KeyframeOf(i);
    ASSERT_TRUE(
        store_.Add({"mapper", 0, i}, {StampOf(i), keyframe.world_from_cam, {}}, keyframe.points_in_camera->Unpack()));
  }
  void AddAll() {
    for (size_t i = 0; i < kViews; ++i) Add(i);
  }
  void Settle() {
    while (mesh_.HasWork()) told_.Take(mesh_.Update());
  }
  /// The same triangles as the saved mesh. Means are taken in another order: some last bits differ, and a triangle at
  /// the border of what was seen may come or go with them.
  void ExpectTheSavedMesh(double tolerance_voxels = 0.01) const {
    const TriangleMesh saved = MakeMapMesh(store_, {0, kMuch}).mesh;
    const auto expected = static_cast<double>(saved.triangles.size());
    ASSERT_GT(expected, 5000);
    EXPECT_NEAR(static_cast<double>(told_.triangles()), expected, 0.001 * expected);
    EXPECT_EQ(told_.triangles(), mesh_.statistics().triangles);
    const double tolerance = tolerance_voxels * mesh_.statistics().voxel_size;
    const auto cell = [&](const Vec3f& p, int i) {
      const auto at = [&](float value, int add) { return static_cast<int>(std::floor(value / kRoomVoxel)) + add; };
      return std::array<int, 3>{at(p.x, i % 3 - 1), at(p.y, i / 3 % 3 - 1), at(p.z, i / 9 - 1)};
    };
    constexpr int kHere = 13;
    std::map<std::array<int, 3>, std::vector<SurfacePoint>> cells;
    for (const SurfacePoint& vertex : saved.vertices) cells[cell(vertex.position, kHere)].push_back(vertex);
    size_t vertices = 0, far = 0, other_color = 0;
    for (const auto& [number, mesh] : told_.blocks) {
      for (const SurfacePoint& vertex : mesh.vertices) {
        double nearest = 1e9;
        Rgb color;
        for (int i = 0; i < 27; ++i) {
          for (const SurfacePoint& other : cells[cell(vertex.position, i)]) {
            const double distance = Norm(vertex.position - other.position);
            if (distance < nearest) nearest = distance, color = other.color;
          }
        }
        ++vertices;
        far += nearest > tolerance ? 1 : 0;
        other_color += std::abs(vertex.color.r - color.r) > 3 ? 1 : 0;
      }
    }
    EXPECT_LT(far, 0.001 * static_cast<double>(vertices));
    EXPECT_LT(other_color, 0.01 * static_cast<double>(vertices));
  }

  MapStore store_{{100, kRoomVoxel}};
  LiveMesh mesh_{&store_, {}};
  ToldMesh told_;
};

TEST_F(LiveMeshTest, GrowsToTheSavedMesh) {
  size_t before = 0;
  for (size_t i = 0; i < kViews; ++i) {
    Add(i);
    told_.Take(mesh_.Update(false));  // what is told at once
    while (mesh_.HasWork(false)) told_.Take(mesh_.Update(false));
    if (i < 3) {
      EXPECT_GT(told_.triangles(), before + 1000) << "keyframe " << i;
    }
    before = told_.triangles();
    store_.LookAroundNext();
  }
  Settle();
  ExpectTheSavedMesh();
  EXPECT_TRUE(mesh_.Update().blocks.empty());
}

TEST_F(LiveMeshTest, FollowsLoopClosuresAndOtherPoints) {
  AddAll();
  Settle();
  std::vector<StampedPose> path;
  for (size_t i = 0; i < kViews; ++i) {
    path.push_back({StampOf(i), KeyframeOf(i).world_from_cam});
    path.back().pose.translation() += Eigen::Vector3d(i < 3 ? 0.5 : 0.0, 0, 0);
  }
  ASSERT_EQ(store_.Repose(path).moved.size(), 3u);
  Settle();
  ExpectTheSavedMesh();
  PointCloud points = PointsOf(Views()[5], [] { return 0.9; });
  ASSERT_TRUE(store_.Replace({"mapper", 0, 5}, {StampOf(5), path[5].pose, {}}, points));
  ASSERT_TRUE(store_.Replace({"mapper", 0, 0}, {StampOf(0), path[0].pose, {}}, {})) << "withdrawn";
  Settle();
  ExpectTheSavedMesh();
  ASSERT_TRUE(
      store_.Replace({"mapper", 0, 0}, {StampOf(0), path[0].pose, {}}, PointsOf(Views()[0], [] { return 1.0; })));
  Settle();
  ExpectTheSavedMesh();
}

/// While blocks are made again, keyframes come, move and go.
TEST_F(LiveMeshTest, ChangesMayComeAtAnyTime) {
  LiveMesh mesh(&store_, {LiveMeshOptions().max_bytes, 3000, 1e-9});  // one keyframe or block at a time
  std::vector<StampedPose> path;
  for (size_t i = 0; i < 2 * kViews; ++i) {
    Add(i);
    path.push_back({StampOf(i), KeyframeOf(i).world_from_cam});
    path.back().pose.translation().y() += 0.02 * static_cast<double>(i % 5);
    store_.LookAroundNext();
    if (i % 4 == 3) store_.Repose(path);
    for (int n = 0; n < 5; ++n) told_.Take(mesh.Update());
  }
  while (mesh.HasWork()) told_.Take(mesh.Update());
  LiveMesh fresh(&store_, {});
  while (fresh.HasWork()) fresh.Update();
  const auto expected = static_cast<double>(fresh.statistics().triangles);
  EXPECT_NEAR(static_cast<double>(told_.triangles()), expected, 0.002 * expected);
  EXPECT_EQ(mesh.statistics().keyframes, 2u * kViews);
}

TEST_F(LiveMeshTest, WhatIsGoneIsTold) {
  MapStore store({1, kRoomVoxel});
  LiveMesh mesh(&store, {});
  for (size_t i : {0u, 3u}) {
    const PlacedKeyframe& keyframe = KeyframeOf(i);
    RigidTransform pose = keyframe.world_from_cam;
    pose.translation().x() += 10.0 * static_cast<double>(i);
    ASSERT_TRUE(store.Add({"mapper", 0, i}, {StampOf(i), pose, {}}, keyframe.points_in_camera->Unpack()));
    while (mesh.HasWork()) told_.Take(mesh.Update());
  }
  EXPECT_GT(told_.gone, 5u) << "the first keyframe's";
  EXPECT_EQ(told_.triangles(), MakeMapMesh(store, {0, kMuch}).mesh.triangles.size()) << "of one keyframe: no mean";
  store.Clear();
  const MeshUpdate update = mesh.Update();
  EXPECT_TRUE(update.anew);
  EXPECT_TRUE(update.blocks.empty());
  EXPECT_FALSE(mesh.HasWork());
  EXPECT_EQ(mesh.statistics().bytes, 0u);
}

TEST_F(LiveMeshTest, UpdatesAreBounded) {
  constexpr size_t kMaxTriangles = 4000;
  LiveMesh mesh(&store_, {LiveMeshOptions().max_bytes, kMaxTriangles, 10});
  AddAll();
  size_t updates = 0;
  for (; mesh.HasWork(); ++updates) told_.Take(mesh.Update());
  EXPECT_LE(told_.largest, kMaxTriangles);
  EXPECT_GT(updates, told_.triangles() / kMaxTriangles);
  const size_t triangles = told_.triangles();
  EXPECT_EQ(triangles, mesh.statistics().triangles) << "nothing is left out";
  mesh.TellAll();
  ToldMesh late;
  while (mesh.HasWork()) late.Take(mesh.Update());
  EXPECT_EQ(late.triangles(), triangles);
  EXPECT_EQ(late.blocks.size(), told_.blocks.size());
  for (const auto& [number, block] : late.blocks) EXPECT_EQ(told_.blocks.count(number), 1u) << "numbers stay";
}

TEST_F(LiveMeshTest, VoxelsGetLargerWhereMemoryIsShort) {
  constexpr size_t kLittle = 3000000;
  LiveMesh mesh(&store_, {kLittle, LiveMeshOptions().max_triangles, 10});
  AddAll();
  while (mesh.HasWork()) {
    told_.Take(mesh.Update());
    EXPECT_LE(mesh.statistics().bytes, kLittle);
  }
  const LiveMeshStatistics statistics = mesh.statistics();
  EXPECT_GE(statistics.coarser, 2);
  EXPECT_NEAR(statistics.voxel_size, statistics.coarser * kRoomVoxel, 1e-9);
  EXPECT_EQ(statistics.keyframes, static_cast<size_t>(kViews));
  const auto expected = static_cast<double>(MakeMapMesh(store_, {statistics.voxel_size, kMuch}).mesh.triangles.size());
  EXPECT_NEAR(static_cast<double>(told_.triangles()), expected, 0.002 * expected) << "as ExpectTheSavedMesh";
}

/// A listener who was too slow gets what it has lost, also that something has gone.
TEST_F(LiveMeshTest, WhatWasToldOnceIsToldOnceMore) {
  const auto repeat = [this](ToldMesh* listener) {
    while (mesh_.Repeat(4)) {
      MeshUpdate update = mesh_.Update();
      EXPECT_LE(update.blocks.size(), 4u);
      listener->Take(std::move(update));
    }
  };
  AddAll();
  Settle();
  ToldMesh deaf;
  deaf.hears_all = false;
  repeat(&deaf);
  EXPECT_EQ(deaf.blocks.size(), told_.blocks.size());
  EXPECT_EQ(deaf.triangles(), told_.triangles());
  std::vector<StampedPose> path;
  for (size_t i = 0; i < kViews; ++i) {
    path.push_back({StampOf(i), KeyframeOf(i).world_from_cam});
    path.back().pose.translation().x() += i < 3 ? 10 : 0;
  }
  ASSERT_EQ(store_.Repose(path).moved.size(), 3u);
  Settle();
  ASSERT_GT(told_.gone, 5u);
  ASSERT_NE(deaf.triangles(), told_.triangles());
  repeat(&deaf);
  EXPECT_EQ(deaf.gone, told_.gone);
  EXPECT_EQ(deaf.triangles(), told_.triangles());
  EXPECT_FALSE(mesh_.HasWork());
}

TEST_F(LiveMeshTest, AnUpdateIsBoundedAlsoWhereAWholeMapIsNew) {
  AddAll();
  LiveMesh mesh(&store_, {LiveMeshOptions().max_bytes, LiveMeshOptions().max_triangles, 1e-9});
  mesh.Update();
  const LiveMeshStatistics first = mesh.statistics();
  EXPECT_EQ(first.keyframes + first.keyframes_to_add, 1u);
  EXPECT_TRUE(mesh.HasWork());
  while (mesh.HasWork()) told_.Take(mesh.Update());
  EXPECT_EQ(mesh.statistics().keyframes, static_cast<size_t>(kViews));
}

TEST_F(LiveMeshTest, AllThatWaitsCountsAsBehind) {
  AddAll();
  Settle();
  EXPECT_EQ(mesh_.statistics().longest_wait_s, 0);
  std::vector<StampedPose> path = {{StampOf(0), KeyframeOf(0).world_from_cam}};
  path[0].pose.translation().x() += 0.5;
  store_.Repose(path);
  while (mesh_.HasWork(false)) mesh_.Update(false);
  const LiveMeshStatistics statistics = mesh_.statistics();
  EXPECT_EQ(statistics.to_tell, 0u);
  EXPECT_GT(statistics.to_make_again, 0u);
  EXPECT_GT(statistics.longest_wait_s, 0) << "of blocks that are to be made again";
}

TEST_F(LiveMeshTest, AfterClearAllIsToldAnew) {
  AddAll();
  Settle();
  mesh_.Clear();
  MeshUpdate update = mesh_.Update();
  EXPECT_TRUE(update.anew);
  told_.Take(std::move(update));
  Settle();
  EXPECT_EQ(told_.triangles(), mesh_.statistics().triangles);
}

TEST(MeshVoxelSize, ChangesInSteps) {
  EXPECT_EQ(MeshVoxelSize({}, 0.02), 0.02);
  EXPECT_EQ(MeshVoxelSize({0, 0, 0.021, 0.02}, 0.02), 0.02);
  EXPECT_NEAR(MeshVoxelSize({0.03}, 0.02), 0.02 * std::sqrt(2), 1e-9);
  EXPECT_NEAR(MeshVoxelSize({0.05}, 0.02), 0.02 * std::sqrt(8), 1e-9);
  const double step = 0.02 * std::sqrt(2), between = 0.02 * std::exp2(0.25);
  for (double spacing : {0.98 * between, 1.02 * between}) {  // where rounding would go to and fro
    EXPECT_EQ(MeshVoxelSize({spacing}, 0.02, 0.02), 0.02);
    EXPECT_EQ(MeshVoxelSize({spacing}, 0.02, step), step);
  }
  EXPECT_NEAR(MeshVoxelSize({0.05}, 0.02, 0.02), 0.02 * std::sqrt(8), 1e-9);
}

}  // namespace
}  // namespace acmp::test
