#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/planar_prior/kernel/support_grid.h"
#include "acmp_mapping/planar_prior/planar_prior.h"
#include "support/error_text.h"

namespace acmp {
namespace {

/// Distinct pixels of a width x height image, the image's border included, all at depth 1.
std::vector<SupportPoint> RandomPoints(int width, int height, int count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<int> any_col(0, width - 1), any_row(0, height - 1);
  std::set<std::pair<int, int>> taken;
  std::vector<SupportPoint> points;
  while (static_cast<int>(points.size()) < count) {
    const int col = any_col(generator), row = any_row(generator);
    if (taken.insert({col, row}).second) points.push_back({col, row, 1.0f});
  }
  return points;
}

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

TEST(TriangulateSupportPoints, RefusesPointsThatAreTooFarApartOrTheSame) {
  constexpr int kFar = 32768;
  for (const SupportPoint& far : {SupportPoint{3 + kFar, 4, 1}, {3 - kFar, 4, 1}, {3, 4 + kFar, 1}}) {
    EXPECT_THROW(TriangulateSupportPoints({{3, 4, 1}, far}), InvalidInputError);
  }
  EXPECT_REFUSED(TriangulateSupportPoints({{3, 4, 1}, {8, 1, 1}, {3, 4, 2}, {9, 9, 1}}), "(3, 4)");
}

TEST(TriangulateSupportPoints, DoesNotDependOnTheOrderOfThePoints) {
  // Many cocircular quadruples: a triangulation that breaks ties by order would differ.
  std::vector<SupportPoint> points = RandomPoints(24, 24, 400, 3);
  const auto sorted_triangles = [](const std::vector<SupportPoint>& given) {
    std::vector<std::array<std::pair<int, int>, 3>> sorted;
    for (const SupportTriangle& triangle : TriangulateSupportPoints(given)) {
      std::array<std::pair<int, int>, 3> pixels;
      for (int k = 0; k < 3; ++k) pixels[k] = {given[triangle.vertex[k]].col, given[triangle.vertex[k]].row};
      std::sort(pixels.begin(), pixels.end());
      sorted.push_back(pixels);
    }
    std::sort(sorted.begin(), sorted.end());
    return sorted;
  };
  const auto expected = sorted_triangles(points);
  for (unsigned seed = 0; seed < 5; ++seed) {
    std::shuffle(points.begin(), points.end(), std::mt19937(seed));
    EXPECT_EQ(sorted_triangles(points), expected);
  }
}

/// Reference for the top-left rule: the pixel moved right by e and down by e^2, e = 1/1000, lies strictly inside. Exact
/// in integers scaled by 1 / e^2, and e is small enough for coordinates below 300: a * e + b * e^2 < 1 and b * e < 1.
bool Covers(const std::vector<SupportPoint>& points, const SupportTriangle& triangle, int col, int row) {
  constexpr long long kScale = 1000000;
  const long long x = col * kScale + 1000, y = row * kScale + 1;
  int positive = 0, negative = 0;
  for (int k = 0; k < 3; ++k) {
    const SupportPoint& p = points[triangle.vertex[k]];
    const SupportPoint& q = points[triangle.vertex[(k + 1) % 3]];
    const long long side = (q.col - p.col) * (y - p.row * kScale) - (q.row - p.row) * (x - p.col * kScale);
    positive += side > 0;
    negative += side < 0;
  }
  return positive == 3 || negative == 3;
}

/// Number of each pixel's triangle. All have a plane in range.
Image<uint32_t> Rasterize(int width, int height, const std::vector<SupportPoint>& points,
                          const std::vector<SupportTriangle>& triangles) {
  PriorMesh mesh = {{}, std::vector<PlaneHypothesis>(triangles.size(), {0, 0, -1, 2})};
  for (const SupportTriangle& triangle : triangles) {
    const SupportPoint &a = points[triangle.vertex[0]], &b = points[triangle.vertex[1]],
                       &c = points[triangle.vertex[2]];
    mesh.triangles.push_back({{a.col, b.col, c.col}, {a.row, b.row, c.row}});
  }
  return RasterizePrior({width, height, 50, 50, 25, 25}, mesh, {1, 3});
}

/// Every pixel against every triangle: at most one covers it, and the raster names exactly that one.
void ExpectExactRaster(int width, int height, const std::vector<SupportPoint>& points) {
  const std::vector<SupportTriangle> triangles = TriangulateSupportPoints(points);
  const Image<uint32_t> numbers = Rasterize(width, height, points, triangles);
  ASSERT_EQ(numbers.width(), width);
  ASSERT_EQ(numbers.height(), height);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      uint32_t expected = 0;
      int count = 0;
      for (size_t i = 0; i < triangles.size(); ++i) {
        if (!Covers(points, triangles[i], col, row)) continue;
        expected = static_cast<uint32_t>(i) + 1;
        ++count;
      }
      ASSERT_LE(count, 1) << col << ", " << row;
      ASSERT_EQ(numbers(col, row), expected) << col << ", " << row;
    }
  }
}

TEST(RasterizePrior, PutsEachPixelInExactlyOneTriangle) {
  for (unsigned seed = 0; seed < 12; ++seed) {
    ExpectExactRaster(67, 41, RandomPoints(67, 41, 3 + 9 * static_cast<int>(seed), seed));
  }
}

TEST(RasterizePrior, IsExactAtTheLargestCoordinates) {
  // The diagonal of a square from corner to corner of the legal range passes through the pixels (i, i): with the
  // top-left rule they belong to the triangle on the right of the diagonal.
  const int limit = 1 << 28;
  const std::vector<SupportPoint> points = {
      {-limit, -limit, 1}, {limit, -limit, 1}, {limit, limit, 1}, {-limit, limit, 1}};
  const Image<uint32_t> numbers = Rasterize(50, 50, points, {{{0, 1, 2}}, {{0, 2, 3}}});
  for (int row = 0; row < 50; ++row) {
    for (int col = 0; col < 50; ++col) ASSERT_EQ(numbers(col, row), col >= row ? 1u : 2u) << col << ", " << row;
  }
}

// The grid's triangles, beside CGAL's.

/// Costs that leave one credible pixel in most cells of 5 x 5 px: at any place in them, none with the chance `missing`,
/// and none in the cells around a hole's middle.
CostMap RandomSupport(double missing, unsigned seed, int hole_radius = 0) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<int> any(0, 4);
  std::uniform_real_distribution<double> chance(0, 1);
  CostMap cost(kCamera.width, kCamera.height, 1);
  for (int row = 0; row < kCamera.height; row += 5) {
    for (int col = 0; col < kCamera.width; col += 5) {
      const int c = col + any(generator), r = row + any(generator);
      const bool in_hole = std::abs(col - 60) < 5 * hole_radius && std::abs(row - 45) < 5 * hole_radius;
      if (chance(generator) >= missing && !in_hole) cost(c, r) = static_cast<float>(0.09 * chance(generator));
    }
  }
  return cost;
}

DepthMap DepthOfPlane(const Eigen::Vector4d& plane) {
  DepthMap depth(kCamera.width, kCamera.height);
  for (int row = 0; row < kCamera.height; ++row) {
    for (int col = 0; col < kCamera.width; ++col) depth(col, row) = static_cast<float>(TrueDepth(plane, col, row));
  }
  return depth;
}

const Eigen::Vector4d kSlanted(0.48, -0.36, -0.8, 3.2);

PriorMesh GridMesh(const DepthMap& depth, const CostMap& cost) {
  return MakeGridMesh(kCamera, depth, cost, kRange, {});
}

TEST(GridMesh, GivesThePlaneOnWhichAllPointsLie) {
  const DepthMap depth = DepthOfPlane(kSlanted);
  for (const double missing : {0.0, 0.3, 0.8}) {
    const PriorMesh mesh = GridMesh(depth, RandomSupport(missing, 5));
    int with_plane = 0;
    for (const PlaneHypothesis& plane : mesh.planes) {
      if (!(plane.d > 0)) continue;
      ++with_plane;
      // Depths of up to 8 are rounded to 2.4e-7 or 4.8e-7, and the thinnest triangles are 1 px high, some 0.02.
      EXPECT_NEAR(plane.nx, kSlanted[0], 1e-4);
      EXPECT_NEAR(plane.ny, kSlanted[1], 1e-4);
      EXPECT_NEAR(plane.nz, kSlanted[2], 1e-4);
      EXPECT_NEAR(plane.d, kSlanted[3], 4e-4);
    }
    EXPECT_GT(with_plane, 100);
  }
}

TEST(GridMesh, CoversWhatTheDelaunayTriangulationCovers) {
  // All but what lies within a cell or two of its hull, on which triangles may span any distance. Holes are closed.
  const DepthMap depth = DepthOfPlane(kSlanted);
  for (const int hole_radius : {0, 2, 6}) {
    for (const double missing : {0.0, 0.2, 0.5}) {
      const CostMap cost = RandomSupport(missing, 6, hole_radius);
      const Image<uint32_t> grid = RasterizePrior(kCamera, GridMesh(depth, cost), kRange);
      const Image<uint32_t> delaunay = MakePlanarPrior(Find(depth, cost), kRange, {});
      int covered = 0, missed = 0;
      const int rim = missing > 0.3 ? 20 : 10;
      for (int row = rim; row < kCamera.height - rim; ++row) {
        for (int col = rim; col < kCamera.width - rim; ++col) {
          covered += delaunay(col, row) > 0;
          missed += delaunay(col, row) > 0 && grid(col, row) == 0;
        }
      }
      EXPECT_GT(covered, 3000);
      EXPECT_EQ(missed, 0) << hole_radius << ", " << missing;
    }
  }
}

TEST(GridMesh, HasOneTrianglePerPixelWhereEachCellHasAPoint) {
  const DepthMap depth(kCamera.width, kCamera.height, 2);
  for (unsigned seed = 0; seed < 5; ++seed) {
    const CostMap cost = RandomSupport(0, seed);
    const PriorMesh mesh = GridMesh(depth, cost);
    for (int row = 5; row < kCamera.height - 5; ++row) {
      for (int col = 5; col < kCamera.width - 5; ++col) {
        int covering = 0;
        for (const TriangleCorners& corners : mesh.triangles) {
          const ColumnSpan span = SpanOfRow(MakeRasterTriangle(corners), row, kCamera.width);
          const auto [low, high] = std::minmax({corners.row[0], corners.row[1], corners.row[2]});
          covering += row >= low && row <= high && col >= span.first && col <= span.last;
        }
        ASSERT_EQ(covering, 1) << col << ", " << row;
      }
    }
  }
}

/// Squared distance of a support point's pixel from the middle of a cell, in quarters of a pixel.
int64_t SquaredDistance(const SupportPoint& point, int col, int row) {
  const int64_t dx = 2 * point.col - (2 * col + 1) * 5, dy = 2 * point.row - (2 * row + 1) * 5;
  return dx * dx + dy * dy;
}

TEST(SupportGrid, FloodingGivesEmptyCellsAPointThatIsHardlyFartherThanTheNearest) {
  const DepthMap depth(kCamera.width, kCamera.height, 2);
  const int cols = kCamera.width / 5, rows = kCamera.height / 5;
  for (const double missing : {0.5, 0.9, 0.99}) {
    const CostMap cost = RandomSupport(missing, 8);
    Image<SupportPoint> points(cols, rows), flooded(cols, rows);
    for (int row = 0; row < rows; ++row) {
      for (int col = 0; col < cols; ++col) {
        points(col, row) = FindSupportPointOfCell(depth.View(), cost.View(), 1, 3, 0.1f, 5, col, row);
      }
    }
    const Image<SupportPoint> own = points.Clone();
    for (int step = FirstFloodingStep(cols, rows); step > 0; step /= 2) {
      for (int row = 0; row < rows; ++row) {
        for (int col = 0; col < cols; ++col) flooded(col, row) = FloodCell(points.View(), 5, step, col, row);
      }
      std::swap(points, flooded);
    }
    int farther = 0;
    for (int row = 0; row < rows; ++row) {
      for (int col = 0; col < cols; ++col) {
        const SupportPoint& found = points(col, row);
        ASSERT_GT(found.depth, 0);
        if (own(col, row).depth > 0) {
          ASSERT_EQ(found.col, own(col, row).col);
          continue;
        }
        int64_t nearest = std::numeric_limits<int64_t>::max();
        for (const SupportPoint& point : own) {
          if (point.depth > 0) nearest = std::min(nearest, SquaredDistance(point, col, row));
        }
        farther += SquaredDistance(found, col, row) > nearest;
      }
    }
    EXPECT_LE(farther, cols * rows / 50) << missing;  // jump flooding errs now and then
  }
}

TEST(GridMesh, OfNoPointsOrOneHasNoPlane) {
  const DepthMap depth(kCamera.width, kCamera.height, 2);
  CostMap cost(kCamera.width, kCamera.height, 1);
  for (int points = 0; points < 3; ++points) {
    for (const PlaneHypothesis& plane : GridMesh(depth, cost).planes) ASSERT_EQ(plane.d, 0) << points;
    cost(17 + 20 * points, 30) = 0.05f;
  }
}

}  // namespace
}  // namespace acmp
