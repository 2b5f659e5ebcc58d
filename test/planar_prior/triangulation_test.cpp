#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "planar_prior/random_points.h"
#include "support/error_text.h"

namespace acmp {
namespace {

__extension__ using Wide = __int128;

/// > 0 if d lies inside the circle through a, b, c of positive area. Exact.
Wide InCircle(const SupportPoint& a, const SupportPoint& b, const SupportPoint& c, const SupportPoint& d) {
  const Wide ax = a.col - d.col, ay = a.row - d.row;
  const Wide bx = b.col - d.col, by = b.row - d.row;
  const Wide cx = c.col - d.col, cy = c.row - d.row;
  const Wide a2 = ax * ax + ay * ay, b2 = bx * bx + by * by, c2 = cx * cx + cy * cy;
  return ax * (by * c2 - b2 * cy) - ay * (bx * c2 - b2 * cx) + a2 * (bx * cy - by * cx);
}

/// Twice the area of the convex hull, by Andrew's monotone chain.
long long DoubledHullArea(std::vector<SupportPoint> points) {
  std::sort(points.begin(), points.end(), [](const SupportPoint& a, const SupportPoint& b) {
    return std::make_pair(a.col, a.row) < std::make_pair(b.col, b.row);
  });
  long long area = 0;
  for (int side = 0; side < 2; ++side) {
    std::vector<SupportPoint> chain;
    for (const SupportPoint& point : points) {
      while (chain.size() >= 2 && DoubledArea(chain[chain.size() - 2], chain.back(), point) <= 0) chain.pop_back();
      chain.push_back(point);
    }
    for (size_t i = 1; i < chain.size(); ++i) area += DoubledArea(points.front(), chain[i - 1], chain[i]);
    std::reverse(points.begin(), points.end());
  }
  return area;
}

/// Checks that the triangles are non-degenerate, turn the same way, tile the hull and have empty circumcircles.
void ExpectDelaunay(const std::vector<SupportPoint>& points) {
  const std::vector<SupportTriangle> triangles = TriangulateSupportPoints(points);
  long long area = 0;
  for (const SupportTriangle& triangle : triangles) {
    const SupportPoint& a = points[triangle.vertex[0]];
    const SupportPoint& b = points[triangle.vertex[1]];
    const SupportPoint& c = points[triangle.vertex[2]];
    ASSERT_GT(DoubledArea(a, b, c), 0);
    area += DoubledArea(a, b, c);
    for (const SupportPoint& d : points) ASSERT_TRUE(InCircle(a, b, c, d) <= 0);
  }
  // Interiors of Delaunay triangles cannot overlap (their circumcircles are empty), so equal areas mean a tiling.
  EXPECT_EQ(area, DoubledHullArea(points));
}

TEST(TriangulateSupportPoints, IsDelaunayForRandomPoints) {
  for (unsigned seed = 0; seed < 20; ++seed)
    ExpectDelaunay(RandomPoints(97, 61, 3 + 15 * static_cast<int>(seed), seed));
}

TEST(TriangulateSupportPoints, IsDelaunayForFullGridsWhereAllQuadsAreCocircular) {
  std::vector<SupportPoint> points;
  for (int row = 0; row < 9; ++row) {
    for (int col = 0; col < 12; ++col) points.push_back({5 * col, 5 * row, 1.0f});
  }
  ExpectDelaunay(points);
  EXPECT_EQ(TriangulateSupportPoints(points).size(), 2u * 8 * 11);
}

TEST(TriangulateSupportPoints, RefusesPointsThatAreTooFarApart) {
  constexpr int kFar = 32768;
  for (const SupportPoint& far : {SupportPoint{3 + kFar, 4, 1.0f}, {3 - kFar, 4, 1.0f}, {3, 4 + kFar, 1.0f}}) {
    EXPECT_THROW(TriangulateSupportPoints({{3, 4, 1.0f}, far}), InvalidInputError);
  }
}

TEST(TriangulateSupportPoints, IsEmptyBelowThreePointsAndOnALine) {
  EXPECT_TRUE(TriangulateSupportPoints({}).empty());
  EXPECT_TRUE(TriangulateSupportPoints({{3, 4, 1.0f}}).empty());
  EXPECT_TRUE(TriangulateSupportPoints({{3, 4, 1.0f}, {8, 1, 1.0f}}).empty());
  std::vector<SupportPoint> line;
  line.reserve(50);
  for (int i = 0; i < 50; ++i) line.push_back({3 * i, 2 * i, 1.0f});
  EXPECT_TRUE(TriangulateSupportPoints(line).empty());
}

TEST(TriangulateSupportPoints, NamesADuplicatePixel) {
  for (const float depth : {1.0f, 2.0f}) {  // whether or not the depths agree
    EXPECT_THAT(ErrorOf([&] {
                  TriangulateSupportPoints({{3, 4, 1.0f}, {8, 1, 1.0f}, {3, 4, depth}, {9, 9, 1.0f}});
                }),
                testing::HasSubstr("(3, 4)"));
  }
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

}  // namespace
}  // namespace acmp
