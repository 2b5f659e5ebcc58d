#include "acmp_mapping/map/map_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/map/occupancy_map.h"
#include "acmp_mapping/mesh/distance_volume.h"
#include "map/room_keyframes.h"

namespace acmp::test {
namespace {

constexpr double kVoxel = 0.02;
constexpr size_t kEnough = 2000000000;

std::vector<SyntheticView> Room() { return MakeSyntheticScene({160, 120, 6}); }

void AddTo(MapStore* store, const PlacedKeyframes& keyframes) {
  for (size_t i = 0; i < keyframes.keyframes.size(); ++i) {
    const PlacedKeyframe& keyframe = keyframes.keyframes[i];
    EXPECT_TRUE(store->Add({"mapper", 0, i}, {static_cast<int64_t>(i) * 1000000000, keyframe.world_from_cam, {}},
                           *keyframe.points_in_camera));
  }
}

TEST(MapMeshTest, IsTheRoomsSurface) {
  const std::vector<SyntheticView> views = Room();
  MapStore store({100, kVoxel});
  AddTo(&store, RoomKeyframes(views, kVoxel));
  const MapMesh map = MakeMapMesh(store, {0, kEnough});
  EXPECT_EQ(map.keyframes, views.size());
  const TriangleMesh& mesh = map.mesh;
  const PointCloud truth = SampleSyntheticSurface(views, 0.02f);
  const auto metrics = EvaluateCloud(SampleMesh(mesh, 0.02), truth, {0.02, 0.05}, 0.02);
  EXPECT_GT(metrics[0].accuracy, 90);
  EXPECT_GT(metrics[1].accuracy, 98);
  EXPECT_GT(metrics[1].completeness, 90);
}

/// Mesh and occupancy in UTM coordinates, where float32 knows half metres only.
TEST(MapMeshTest, FarFromTheOriginItIsTheSame) {
  PlacedKeyframes keyframes = RoomKeyframes(Room(), kVoxel);
  const Eigen::Vector3d offset(500000, 5500000, 200);
  MapStore near({100, kVoxel}), far({100, kVoxel});
  AddTo(&near, keyframes);
  for (PlacedKeyframe& keyframe : keyframes.keyframes) keyframe.world_from_cam.translation() += offset;
  AddTo(&far, keyframes);
  const MapMesh expected = MakeMapMesh(near, {0.04, kEnough}), map = MakeMapMesh(far, {0.04, kEnough});
  EXPECT_NEAR(static_cast<double>(map.mesh.triangles.size()), static_cast<double>(expected.mesh.triangles.size()),
              0.01 * static_cast<double>(expected.mesh.triangles.size()));
  const auto middle = [](const MapMesh& m) {
    Eigen::AlignedBox3d box;
    for (const SurfacePoint& v : m.mesh.vertices) box.extend(InWorld(m.origin, v.position));
    return Eigen::Vector3d(box.center());
  };
  EXPECT_LT((middle(map) - offset - middle(expected)).norm(), 0.04);
  const auto cells = [](const MapStore& store) {
    return static_cast<double>(MakeOccupancyMap(store.Placed(), 0.1)->nodes());
  };
  EXPECT_NEAR(cells(far), cells(near), 0.05 * cells(near)) << "the grid lies in another way";
}

}  // namespace
}  // namespace acmp::test
