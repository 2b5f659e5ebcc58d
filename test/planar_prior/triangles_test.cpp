#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <utility>
#include <vector>

#include "planar_prior/random_points.h"
#include "support/error_text.h"

namespace acmp {
namespace {

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
void ExpectExactRaster(int width, int height, const std::vector<SupportPoint>& points,
                       const std::vector<SupportTriangle>& triangles) {
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

void ExpectExactRaster(int width, int height, const std::vector<SupportPoint>& points) {
  ExpectExactRaster(width, height, points, TriangulateSupportPoints(points));
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

}  // namespace
}  // namespace acmp
