#include "acmp_mapping/evaluation/cloud_metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

TriangleMesh Square(float size) {
  TriangleMesh mesh;
  for (const auto& [x, y] : {std::pair{0.0f, 0.0f}, {size, 0.0f}, {size, size}, {0.0f, size}}) {
    mesh.vertices.push_back({{x, y, 2}, {0, 0, -1}, {1, 2, 3}, 1});
  }
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

TEST(SampleMesh, CoversTheSurface) {
  constexpr double kSpacing = 0.1;
  const PointCloud points = SampleMesh(Square(1), kSpacing);
  EXPECT_EQ(points.size(), 2u * 15 * 15) << "sqrt(2) / 0.1 is cut into 15 parts";
  for (float x = 0; x <= 1; x += 0.05f) {
    for (float y = 0; y <= 1; y += 0.05f) {
      double nearest = 1;
      for (const SurfacePoint& point : points) {
        nearest = std::min<double>(nearest, Norm(point.position - Vec3f{x, y, 2}));
      }
      EXPECT_LT(nearest, kSpacing) << x << ", " << y;
    }
  }
}

TEST(SampleMesh, RefusesWhatItCannotDo) {
  EXPECT_THROW(SampleMesh(Square(1), 0), InvalidInputError);
  EXPECT_THROW(SampleMesh(Square(1), std::numeric_limits<double>::quiet_NaN()), InvalidInputError);
  EXPECT_THROW(SampleMesh(Square(1000), 1e-3), InvalidInputError);
}

}  // namespace
}  // namespace acmp
