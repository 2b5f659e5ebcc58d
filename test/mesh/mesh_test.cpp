#include <tbb/global_control.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <set>
#include <vector>

#include "acmp_mapping/mesh/distance_volume.h"
#include "acmp_mapping/mesh/splat_points.h"
#include "support/error_text.h"

namespace acmp::test {
namespace {

constexpr double kSphereRadius = 0.5;
constexpr Rgb kSphereColor = {200, 100, 51};

/// What a camera at `position` that looks along `forward` sees of a sphere around the origin, exactly.
SurfaceMaps SeeSphere(const Eigen::Vector3d& position) {
  SurfaceMaps maps;
  maps.camera.camera = {120, 100, 110, 110, 59.5, 49.5};
  const Eigen::Vector3d forward = -position.normalized();
  const Eigen::Vector3d right = Eigen::Vector3d::UnitZ().cross(forward).normalized();
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.linear() << right, forward.cross(right), forward;
  world_from_cam.translation() = position;
  maps.camera.cam_from_world = world_from_cam.inverse();
  const PinholeCamera& camera = maps.camera.camera;
  maps.depth = DepthMap(camera.width, camera.height);
  maps.normal = NormalMap(camera.width, camera.height);
  maps.confidence = ConfidenceMap(camera.width, camera.height);
  maps.color = ColorImage(camera.width, camera.height, kSphereColor);
  const Eigen::Vector3d center = maps.camera.cam_from_world * Eigen::Vector3d(0, 0, 0);
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector3d ray = camera.Unproject({col, row});
      const double along = ray.dot(center), squared = ray.squaredNorm();
      const double root = along * along - squared * (center.squaredNorm() - kSphereRadius * kSphereRadius);
      if (root <= 0) continue;
      const double depth = (along - std::sqrt(root)) / squared;
      const Eigen::Vector3d normal = (depth * ray - center).normalized();
      maps.depth(col, row) = static_cast<float>(depth);
      maps.normal(col, row) = {static_cast<float>(normal.x()), static_cast<float>(normal.y()),
                               static_cast<float>(normal.z())};
      maps.confidence(col, row) = 0.9f;
    }
  }
  return maps;
}

/// From four sides; the poles are seen at a slant.
std::vector<SurfaceMaps> SeeSphereFromAround() {
  std::vector<SurfaceMaps> views;
  for (const auto& [x, y] : {std::pair{1.5, 0.2}, {-0.2, 1.5}, {-1.5, -0.2}, {0.2, -1.5}}) {
    views.push_back(SeeSphere({x, y, 0.1}));
  }
  return views;
}

Eigen::Vector3d Position(const SurfacePoint& point) { return {point.position.x, point.position.y, point.position.z}; }

Eigen::Vector3d Normal(const SurfacePoint& point) { return {point.normal.x, point.normal.y, point.normal.z}; }

constexpr double kVoxel = 0.02;
constexpr size_t kEnough = 1000000000;

class DistanceVolumeTest : public ::testing::Test {
 protected:
  static TriangleMesh MeshOf(const std::vector<SurfaceMaps>& views, const DistanceVolumeOptions& options) {
    DistanceVolume volume(options);
    for (const SurfaceMaps& view : views) volume.Integrate(view.View());
    return volume.ExtractMesh();
  }
  static TriangleMesh SphereMesh() { return MeshOf(SeeSphereFromAround(), {kVoxel, kEnough, 0}); }
};

TEST_F(DistanceVolumeTest, SphereHasItsSurfaceAndNothingElse) {
  const TriangleMesh mesh = SphereMesh();
  ASSERT_GT(mesh.vertices.size(), 5000u);  // 4 pi r^2 / voxel^2 = 7854 without the poles
  size_t near = 0;
  for (const SurfacePoint& vertex : mesh.vertices) {
    const double error = std::abs(Position(vertex).norm() - kSphereRadius);
    EXPECT_LT(error, 0.5 * kVoxel);
    near += error < 0.1 * kVoxel ? 1 : 0;
    EXPECT_GT(Normal(vertex).dot(Position(vertex).normalized()), 0.8) << "points outwards";
    EXPECT_NEAR(vertex.color.r, kSphereColor.r, 1);
    EXPECT_NEAR(vertex.color.b, kSphereColor.b, 1);
    EXPECT_GT(vertex.confidence, 0.1f);
    EXPECT_LT(vertex.confidence, 1.0f);
  }
  EXPECT_GT(static_cast<double>(near), 0.95 * static_cast<double>(mesh.vertices.size()));
  double area = 0;
  for (const auto& [i, j, k] : mesh.triangles) {
    const Eigen::Vector3d a = Position(mesh.vertices[i]);
    const Eigen::Vector3d normal = (Position(mesh.vertices[j]) - a).cross(Position(mesh.vertices[k]) - a);
    EXPECT_GT(normal.dot(a), 0) << "faces outwards";
    area += normal.norm() / 2;
  }
  const double all = 4 * M_PI * kSphereRadius * kSphereRadius;
  EXPECT_GT(area, 0.6 * all);  // the poles are out of sight, and beside an outline nothing is seen in front of it
  EXPECT_LT(area, 1.01 * all);
}

TEST_F(DistanceVolumeTest, OneViewHasNoBack) {
  std::vector<SurfaceMaps> views;
  views.push_back(SeeSphere({1.5, 0, 0}));
  const TriangleMesh mesh = MeshOf(views, {kVoxel, kEnough, 0});
  ASSERT_GT(mesh.triangles.size(), 1000u);
  for (const SurfacePoint& vertex : mesh.vertices) {
    EXPECT_NEAR(Position(vertex).norm(), kSphereRadius, 0.5 * kVoxel);
    EXPECT_GT(Position(vertex).x(), 0) << "the camera is there";
  }
}

/// By the positions of their corners.
std::vector<std::array<float, 9>> SortedTriangles(const std::vector<TriangleMesh>& meshes) {
  std::vector<std::array<float, 9>> triangles;
  for (const TriangleMesh& mesh : meshes) {
    for (const auto& triangle : mesh.triangles) {
      triangles.emplace_back();
      for (size_t i = 0; i < 3; ++i) {
        std::memcpy(&triangles.back()[3 * i], &mesh.vertices[triangle[i]].position, sizeof(Vec3f));
      }
    }
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

TEST_F(DistanceVolumeTest, BlocksTogetherAreTheWholeMesh) {
  DistanceVolume volume({kVoxel, kEnough, 0});
  std::set<VolumeBlock> blocks;
  for (const SurfaceMaps& view : SeeSphereFromAround()) {
    for (const VolumeBlock& block : volume.Integrate(view.View())) blocks.insert(block);
  }
  ASSERT_GE(blocks.size(), 8u) << "around the origin";
  std::vector<TriangleMesh> one_by_one;
  for (const VolumeBlock& block : blocks) one_by_one.push_back(volume.ExtractBlocks({block})[0]);
  const auto whole = SortedTriangles({volume.ExtractMesh()});
  EXPECT_EQ(SortedTriangles(one_by_one), whole) << "none twice, none missing, at the same places";
  EXPECT_EQ(SortedTriangles(volume.ExtractBlocks({blocks.begin(), blocks.end()})), whole);
  const double size = kBlockVoxels * kVoxel;
  for (size_t i = 0; i < one_by_one.size(); ++i) {
    const VolumeBlock& block = *std::next(blocks.begin(), static_cast<std::ptrdiff_t>(i));
    for (const SurfacePoint& vertex : one_by_one[i].vertices) {
      EXPECT_GT(vertex.position.x, block[0] * size - 2 * kVoxel);
      EXPECT_LT(vertex.position.x, (block[0] + 1) * size + 2 * kVoxel);
    }
  }
}

TEST_F(DistanceVolumeTest, BlocksMadeBesideTakeTheirPlaces) {
  const std::vector<SurfaceMaps> views = SeeSphereFromAround();
  DistanceVolume volume({kVoxel, kEnough, 0}), beside({kVoxel, kEnough, 0});
  volume.Integrate(views[0].View());
  const auto before = SortedTriangles({volume.ExtractMesh()});
  const std::vector<VolumeBlock> seen = volume.Integrate(views[1].View());
  const std::vector<VolumeBlock> some = {seen[1], seen[3]};
  EXPECT_EQ(beside.Integrate(views[0].View(), some), DistanceVolume({kVoxel, kEnough, 0}).Integrate(views[0].View()))
      << "also those that stay as they are";
  EXPECT_LE(beside.bytes(), 2 * kFullBlockBytes);
  volume.Replace(some, &beside);
  EXPECT_EQ(beside.voxels(), 0u);
  volume.Replace(seen, &beside);
  DistanceVolume first({kVoxel, kEnough, 0});
  first.Integrate(views[0].View());
  volume.Replace(seen, &first);
  EXPECT_EQ(SortedTriangles({volume.ExtractMesh()}), before) << "as if the second view had not been";
}

TEST_F(DistanceVolumeTest, TheNumberOfThreadsDoesNotMatter) {
  const TriangleMesh many = SphereMesh();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const TriangleMesh single = SphereMesh();
  ASSERT_EQ(many.vertices.size(), single.vertices.size());
  EXPECT_EQ(many.triangles, single.triangles);
  for (size_t i = 0; i < many.vertices.size(); ++i) {
    EXPECT_EQ(std::memcmp(&many.vertices[i].position, &single.vertices[i].position, sizeof(Vec3f)), 0);
  }
}

TEST_F(DistanceVolumeTest, DoubtfulPixelsTakeNoPart) {
  SurfaceMaps view = SeeSphere({1.5, 0, 0});
  DistanceVolume strict({kVoxel, kEnough, 0.95f});
  strict.Integrate(view.View());
  EXPECT_EQ(strict.voxels(), 0u);
  for (float& confidence : view.confidence) confidence = 0;
  DistanceVolume volume({kVoxel, kEnough, 0});
  volume.Integrate(view.View());
  EXPECT_EQ(volume.voxels(), 0u);
  EXPECT_TRUE(volume.ExtractMesh().vertices.empty());
}

TEST_F(DistanceVolumeTest, MoreMemoryThanAllowedIsRefusedAndChangesNothing) {
  const SurfaceMaps view = SeeSphere({1.5, 0, 0});
  DistanceVolume volume({kVoxel, 1000000, 0});
  volume.Integrate(view.View());
  const size_t before = volume.voxels();
  const SurfaceMaps other_side = SeeSphere({-1.5, 0, 0});
  EXPECT_REFUSED(volume.Integrate(other_side.View()), "voxels of 0.02", "take 2 MB, more than the 1 MB",
                 "voxel size must be larger");
  EXPECT_EQ(volume.voxels(), before);
  DistanceVolume beside({kVoxel, kEnough, 0});
  const std::vector<VolumeBlock> seen = beside.Integrate(other_side.View());
  EXPECT_THROW(volume.Replace(seen, &beside), VoxelsTooSmallError) << "as much as with Integrate";
  EXPECT_EQ(volume.voxels(), before);
  EXPECT_GT(beside.voxels(), 0u);
  DistanceVolume tiny({1e-10, kEnough, 0});
  EXPECT_THROW(tiny.Integrate(view.View()), VoxelsTooSmallError);
}

TEST(VoxelSize, IsSoManyPixelsAtTheMedianDepth) {
  const PinholeCamera camera = {5, 1, 100, 100, 2, 0};
  DepthMap depth(5, 1);
  EXPECT_EQ(MedianFootprint(camera, depth), 0);
  for (int col = 0; col < 3; ++col) depth(col, 0) = static_cast<float>(1 + col);
  EXPECT_NEAR(MedianFootprint(camera, depth), 0.02, 1e-9);
  EXPECT_NEAR(DefaultVoxelSize({0, 0.01, 0.02, 0.03}), kVoxelPixels * 0.02, 1e-9);
  EXPECT_THROW(DefaultVoxelSize({0, 0}), InvalidInputError);
}

TEST(SplatPoints, DrawsPointsThatAreNotApartOnce) {
  const SurfacePoint near = {{0, 0, 1e-4f}, {0, 0, -1}, {9, 8, 7}, 0, 0.5f};  // over the whole image
  const PosedCamera camera = {{200, 150, 200, 200, 100, 75}, RigidTransform::Identity()};
  const SurfaceMaps one = SplatPoints({near}, camera, kVoxel);
  const SurfaceMaps many = SplatPoints(PointCloud(1000000, near), camera, kVoxel);  // minutes, if all are drawn
  ASSERT_EQ(many.depth.size(), one.depth.size());
  EXPECT_TRUE(std::equal(many.depth.begin(), many.depth.end(), one.depth.begin()));
  EXPECT_GT(many.depth(100, 75), 0);
}

TEST(SplatPoints, LeavesOutWhatNoCameraSees) {
  const PointCloud points = {{{0, 0, -1}, {0, 0, -1}, {}, 0, 1}, {{10, 0, 1}, {0, 0, -1}, {}, 0, 1}};
  EXPECT_TRUE(SplatPoints(points, RigidTransform::Identity(), kVoxel).depth.empty());
  EXPECT_TRUE(SplatPoints({}, RigidTransform::Identity(), kVoxel).depth.empty());
  const PointCloud one = {{{0, 0, 1}, {0, 0, -1}, {9, 8, 7}, 0, 0.5f}};
  const SurfaceMaps maps = SplatPoints(one, RigidTransform::Identity(), kVoxel);
  EXPECT_EQ(maps.depth.size(), 1u);
  EXPECT_NEAR(maps.depth(0, 0), 1, 1e-6);
  EXPECT_EQ(maps.confidence(0, 0), 0.5f);
  EXPECT_EQ(maps.color(0, 0).g, 8);
  // A square on the point's plane 0.6 x - 0.8 z = -0.8, here at x = 0.02 z.
  const PosedCamera camera = {{21, 21, 100, 100, 10, 10}, RigidTransform::Identity()};
  const SurfaceMaps slanted = SplatPoints({{{0, 0, 1}, {0.6f, 0, -0.8f}, {}, 0, 1}}, camera, 0.05);
  EXPECT_NEAR(slanted.depth(12, 10), 0.8 / (0.8 - 0.6 * 0.02), 1e-5);
}

TEST(SplatPoints, AFewPointsMakeNoLargeImage) {
  const PosedCamera camera = {{4400, 4400, 4000, 4000, 2199.5, 2199.5}, RigidTransform::Identity()};
  const SurfaceMaps maps = SplatPoints({{{0, 0, 2}, {0, 0, -1}, {}, 0, 1}}, camera, 0.02);
  EXPECT_LE(maps.depth.size(), 640u * 480u);
  EXPECT_TRUE(maps.camera.camera == camera.camera.Resized(maps.depth.width(), maps.depth.height()));
  EXPECT_NEAR(maps.depth(maps.depth.width() / 2, maps.depth.height() / 2), 2, 1e-6);
  EXPECT_TRUE(SplatCamera(camera.camera, 400000) == camera.camera) << "a dense one is as it is";
}

}  // namespace
}  // namespace acmp::test
