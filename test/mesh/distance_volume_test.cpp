#include "acmp_mapping/mesh/distance_volume.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstring>

#include "acmp_mapping/common/error.h"
#include "mesh/sphere_views.h"
#include "support/error_text.h"

namespace acmp::test {
namespace {

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
}

TEST_F(DistanceVolumeTest, TrianglesFaceOutwardsAndCoverTheSphere) {
  const TriangleMesh mesh = SphereMesh();
  double area = 0;
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d a = Position(mesh.vertices[triangle[0]]);
    const Eigen::Vector3d normal =
        (Position(mesh.vertices[triangle[1]]) - a).cross(Position(mesh.vertices[triangle[2]]) - a);
    EXPECT_GT(normal.dot(a), 0);
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
  DistanceVolume tiny({1e-10, kEnough, 0});
  EXPECT_REFUSED(tiny.Integrate(view.View()), "more than 2^30 voxels of 1e-10");
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

}  // namespace
}  // namespace acmp::test
