#include "acmp_mapping/planar_prior/planar_prior.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "planar_prior/random_points.h"

namespace acmp {
namespace {

const float kNan = std::numeric_limits<float>::quiet_NaN();
const DepthRange kRange = {1.0f, 10.0f};
const PinholeCamera kCamera = {120, 90, 100, 105, 58.3, 44.1};

Image<uint32_t> MakePlanarPrior(const std::vector<SupportPoint>& points, const DepthRange& range,
                                const PlanarPriorOptions& options) {
  return RasterizePrior(kCamera, MakePriorMesh(kCamera, points, options), range);
}

std::vector<SupportPoint> Find(const DepthMap& depth, const CostMap& cost, const PlanarPriorOptions& options = {},
                               const DepthRange& range = kRange) {
  return FindSupportPoints(depth.View(), cost.View(), range, options);
}

/// Plain search: the best pixel of each cell, cells in row-major order.
std::vector<SupportPoint> SupportPointsByExhaustion(const DepthMap& depth, const CostMap& cost, int cell_size,
                                                    float max_cost) {
  std::vector<SupportPoint> points;
  for (int cell_row = 0; cell_row * cell_size < depth.height(); ++cell_row) {
    for (int cell_col = 0; cell_col * cell_size < depth.width(); ++cell_col) {
      int best_col = -1, best_row = -1;
      for (int row = 0; row < depth.height(); ++row) {
        for (int col = 0; col < depth.width(); ++col) {
          if (row / cell_size != cell_row || col / cell_size != cell_col) continue;
          if (!(depth(col, row) >= kRange.min && depth(col, row) <= kRange.max)) continue;
          if (!(cost(col, row) < max_cost)) continue;
          if (best_col >= 0 && cost(col, row) >= cost(best_col, best_row)) continue;
          best_col = col;
          best_row = row;
        }
      }
      if (best_col >= 0) points.push_back({best_col, best_row, depth(best_col, best_row)});
    }
  }
  return points;
}

TEST(FindSupportPoints, AgreesWithExhaustiveSearch) {
  DepthMap depth(53, 37);
  CostMap cost(53, 37);
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> any_depth(0.5f, 11.0f);
  std::uniform_int_distribution<int> any_cost(0, 40), any_fault(0, 9);
  for (float& z : depth) z = any_fault(generator) == 0 ? kNan : any_depth(generator);
  for (float& c : cost) c = any_fault(generator) == 0 ? kNan : 0.02f * any_cost(generator);  // many equal costs
  for (const int cell_size : {1, 3, 5, 64}) {
    PlanarPriorOptions options;
    options.cell_size_px = cell_size;
    options.max_support_cost = 0.3f;
    const auto points = Find(depth, cost, options);
    const auto expected = SupportPointsByExhaustion(depth, cost, cell_size, 0.3f);
    ASSERT_EQ(points.size(), expected.size()) << cell_size;
    for (size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(points[i].col, expected[i].col);
      EXPECT_EQ(points[i].row, expected[i].row);
      EXPECT_EQ(points[i].depth, expected[i].depth);
    }
  }
}

/// Depth of n.X = -d at a pixel, in double.
double TrueDepth(const Eigen::Vector4d& plane, double col, double row) {
  return -plane[3] / plane.head<3>().dot(kCamera.Unproject({col, row}));
}

int CountPixels(const Image<uint32_t>& numbers) {
  return static_cast<int>(numbers.size() - std::count(numbers.begin(), numbers.end(), 0u));
}

TEST(PlanarPrior, PassesThroughTheVerticesOfEachTriangle) {
  // Depths at random: every triangle has a plane of its own. It must meet the rays of its three vertices at their
  // depths.
  std::vector<SupportPoint> points = RandomPoints(kCamera.width, kCamera.height, 60, 8);
  std::mt19937 generator(8);
  std::uniform_real_distribution<float> any_depth(3.0f, 4.0f);
  for (SupportPoint& point : points) point.depth = any_depth(generator);
  PlanarPriorOptions options;
  options.max_grazing_angle_deg = 89.9f;
  const auto triangles = TriangulateSupportPoints(points);
  const PriorMesh mesh = MakePriorMesh(kCamera, points, options);
  const Image<uint32_t> numbers = RasterizePrior(kCamera, mesh, kRange);
  int checked = 0;
  for (int row = 0; row < kCamera.height; ++row) {
    for (int col = 0; col < kCamera.width; ++col) {
      if (numbers(col, row) == 0) continue;
      const PlaneHypothesis& p = mesh.planes.at(numbers(col, row) - 1);
      ASSERT_GT(p.d, 0);
      for (int vertex : triangles[numbers(col, row) - 1].vertex) {
        const SupportPoint& point = points[vertex];
        const Eigen::Vector3d ray = kCamera.Unproject({point.col, point.row});
        const double cosine = Eigen::Vector3d(p.nx, p.ny, p.nz).dot(ray);
        // Distance of the vertex from the float plane: rounding of n (6e-8) and d (2.4e-7) at 4 units.
        ASSERT_NEAR(cosine * point.depth + p.d, 0, 2e-6);
      }
      ++checked;
    }
  }
  EXPECT_GT(checked, 3000);
}

TEST(PlanarPrior, RejectsGrazingTriangles) {
  // A plane through a triangle's centroid whose normal makes the given angle with the ray there.
  const auto count = [](double angle_deg) {
    std::vector<SupportPoint> points = {{30, 30, 0}, {33, 30, 0}, {30, 33, 0}};
    const Eigen::Vector3d ray = kCamera.Unproject({31, 31}).normalized();
    const Eigen::Vector3d side = ray.unitOrthogonal();
    const double angle = angle_deg * M_PI / 180;
    Eigen::Vector4d plane;
    plane.head<3>() = -std::cos(angle) * ray + std::sin(angle) * side;
    plane[3] = -plane.head<3>().dot(4.0 * ray);
    Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
    for (SupportPoint& point : points) {
      point.depth = static_cast<float>(TrueDepth(plane, point.col, point.row));
      centroid += kCamera.Unproject({point.col, point.row}, point.depth) / 3;
    }
    // The true centroid of the slanted triangle is not on the ray through the middle: state the angle really made.
    const double cosine = -plane.head<3>().dot(centroid.normalized());
    PlanarPriorOptions options;
    options.max_grazing_angle_deg = static_cast<float>(std::acos(cosine) * 180 / M_PI + 0.01);
    const int just_inside = CountPixels(MakePlanarPrior(points, kRange, options));
    options.max_grazing_angle_deg -= 0.02f;
    const int just_outside = CountPixels(MakePlanarPrior(points, kRange, options));
    return std::make_pair(just_inside, just_outside);
  };
  for (const double angle_deg : {10.0, 45.0, 80.0}) {
    EXPECT_EQ(count(angle_deg), std::make_pair(6, 0)) << angle_deg;  // 3 + 2 + 1 pixels of the half-open triangle
  }
}

TEST(PlanarPrior, RejectsPixelsWhereThePlaneLeavesTheRange) {
  Eigen::Vector4d plane;
  plane << Eigen::Vector3d(0.6, 0, -0.8), 3.0;
  std::vector<SupportPoint> points = {{0, 0, 0}, {119, 0, 0}, {0, 89, 0}, {119, 89, 0}};
  for (SupportPoint& point : points) point.depth = static_cast<float>(TrueDepth(plane, point.col, point.row));
  const DepthRange range = {3.0f, 4.0f};
  const Image<uint32_t> numbers = MakePlanarPrior(points, range, {});
  int inside = 0;
  for (int row = 0; row + 1 < kCamera.height; ++row) {
    for (int col = 0; col + 1 < kCamera.width; ++col) {
      const double z = TrueDepth(plane, col, row);
      if (std::abs(z - range.min) < 1e-4 || std::abs(z - range.max) < 1e-4) continue;  // float rounding decides
      ASSERT_EQ((numbers(col, row) != 0), z > range.min && z < range.max) << col << ", " << row;
      inside += numbers(col, row) != 0 ? 1 : 0;
    }
  }
  EXPECT_GT(inside, 1000);
  EXPECT_LT(inside, 119 * 89 - 1000);
}

}  // namespace
}  // namespace acmp
