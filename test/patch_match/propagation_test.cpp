#include "acmp_mapping/patch_match/kernel/propagation.h"

#include <algorithm>
#include <set>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

using Offset = std::pair<int, int>;

/// ACMH's sampling, spelt out for "up" and "far up" and turned for the other directions.
std::set<Offset> ReferenceRegion(int region) {
  std::set<Offset> up = {{0, -1}, {-1, -2}, {1, -2}, {-2, -3}, {2, -3}, {-3, -4}, {3, -4}};
  if (region >= 4) {
    up.clear();
    for (const int distance : {3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23}) up.insert({0, -distance});
  }
  std::set<Offset> turned;
  for (const auto& [x, y] : up) {
    switch (region % 4) {
      case 0:
        turned.insert({x, y});
        break;
      case 1:
        turned.insert({x, -y});
        break;
      case 2:
        turned.insert({y, x});
        break;
      default:
        turned.insert({-y, x});
    }
  }
  return turned;
}

/// Reference: indices of all members with the least cost; empty if no member lies in the image.
std::set<int> ReferenceBest(const KernelState& state, int col, int row, int region) {
  std::set<int> best;
  float least = 0;
  for (const auto& [dx, dy] : ReferenceRegion(region)) {
    const int x = col + dx, y = row + dy;
    if (x < 0 || y < 0 || x >= state.width() || y >= state.height()) continue;
    const float cost = state.cost(x, y);
    if (best.empty() || cost < least) {
      best.clear();
      least = cost;
    }
    if (cost == least) best.insert(y * state.width() + x);
  }
  return best;
}

TEST(PropagationTest, TakesTheMemberOfLeastCostEverywhere) {
  for (const auto& [width, height] : {std::pair(61, 57), {7, 5}, {1, 30}, {30, 1}, {2, 2}}) {
    const std::vector<PlanarView> views = RandomViews(2, width, height, 1);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    TestRandom random(2);
    for (float& cost : state.cost) cost = static_cast<float>(random.Below(50)) / 25.0f;  // with ties and zeros
    int absent = 0;
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        for (int region = 0; region < kNumRegions; ++region) {
          const std::set<int> expected = ReferenceBest(state, col, row, region);
          const int best = BestOfRegion(state.Context(), col, row, region);
          if (expected.empty()) {
            ASSERT_EQ(best, -1) << col << ", " << row << ", region " << region;
            ++absent;
          } else {
            ASSERT_EQ(expected.count(best), 1u) << col << ", " << row << ", region " << region;
          }
        }
      }
    }
    EXPECT_GT(absent, 0);
  }
}

TEST(PropagationTest, NearAndFarRegionsTakeTurns) {
  for (uint32_t turn = 0; turn < 4; ++turn) {
    for (int row = 0; row < 9; ++row) {
      for (int col = 0; col < 9; ++col) {
        const RegionRange regions = AlternatingRegions(col, row, turn);
        EXPECT_EQ(regions.count, 4);
        EXPECT_TRUE(regions.first == 0 || regions.first == 4);
        EXPECT_EQ(regions.first, AlternatingRegions(col / 2 * 2, row / 2 * 2, turn).first) << "a block has one turn";
        EXPECT_NE(regions.first, AlternatingRegions(col + 2, row, turn).first);
        EXPECT_NE(regions.first, AlternatingRegions(col, row + 2, turn).first);
        EXPECT_NE(regions.first, AlternatingRegions(col, row, turn + 1).first);
      }
    }
  }
}

/// Which regions' candidates a pixel gets.
class CandidatesTest : public ::testing::TestWithParam<RegionRange> {};

TEST_P(CandidatesTest, AreThePlanesOfTheBestMembersThatMeetTheRayInRange) {
  const RegionRange regions = GetParam();
  const std::vector<PlanarView> views = RandomViews(2, 41, 35, 4);
  KernelState state(MakeProblem(views, 0, {2, 6}));
  TestRandom random(5);
  for (int row = 0; row < 35; ++row) {
    for (int col = 0; col < 41; ++col) {
      state.cost(col, row) = static_cast<float>(random(0, 2));  // no ties: the best member is unique
      state.planes(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 6, 85, &random);
    }
  }
  const auto context = state.Context();
  int outside = 0;
  for (int row = 0; row < 35; ++row) {
    for (int col = 0; col < 41; ++col) {
      std::vector<PlaneHypothesis> expected;
      bool ambiguous = false;
      for (int region = regions.first; region < regions.first + regions.count; ++region) {
        const std::set<int> best = ReferenceBest(state, col, row, region);
        if (best.empty()) continue;
        const PlaneHypothesis plane = state.planes.data()[*best.begin()];
        const double depth =
            reference::Intersect(views[0].camera, Eigen::Vector2d(col, row), reference::ToDouble(plane)).z();
        // Rounding of a grazing plane's depth may decide at the ends of the range.
        ambiguous |= std::abs(depth - 2) < 1e-3 || std::abs(depth - 6) < 1e-3;
        if (depth >= 2 && depth <= 6) {
          expected.push_back(plane);
        } else {
          ++outside;
        }
      }
      if (ambiguous) continue;
      PlaneHypothesis candidates[kNumRegions];
      int shared_count;
      const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
      const int count = CollectCandidates(context, col, row, ray, regions, SingleThread(), candidates, &shared_count);
      ASSERT_EQ(count, static_cast<int>(expected.size())) << col << ", " << row;
      for (int i = 0; i < count; ++i) {
        EXPECT_TRUE(candidates[i].nx == expected[i].nx && candidates[i].ny == expected[i].ny &&
                    candidates[i].nz == expected[i].nz && candidates[i].d == expected[i].d);
      }
    }
  }
  EXPECT_GT(outside, 100);  // the range does exclude some
}

INSTANTIATE_TEST_SUITE_P(AllNearAndFar, CandidatesTest,
                         ::testing::Values(kAllRegions, RegionRange{0, 4}, RegionRange{4, 4}));

}  // namespace
}  // namespace acmp
