#include "acmp_mapping/fill/kernel/weighted_median.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>

#include "gtest/gtest.h"

#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "support/group_threads.h"

namespace acmp {
namespace {

TEST(WeightedMedianTest, OfManySamplesHalfOfTheWeightLiesUpToIt) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (int round = 0; round < 200; ++round) {
    MedianSamples<1> samples;
    for (int n = 0; n < kMedianSamples; ++n) {
      // Some count for nothing, and some have the same depth.
      samples.depth[n] = 2 + std::round(20 * uniform(random)) / 10;
      samples.weight[n] = uniform(random) < 0.3f ? 0 : uniform(random);
    }
    const int median = WeightedMedianOf(samples, SingleThread());
    ASSERT_GE(median, 0);
    EXPECT_GT(samples.weight[median], 0);
    double nearer = 0, up_to = 0, all = 0;
    for (int n = 0; n < kMedianSamples; ++n) {
      all += samples.weight[n];
      nearer += samples.depth[n] < samples.depth[median] ? samples.weight[n] : 0;
      up_to += samples.depth[n] <= samples.depth[median] ? samples.weight[n] : 0;
    }
    // Depths differ by a twentieth of their range, so that bisection tells them apart; sums in float.
    EXPECT_LE(nearer, 0.5 * all + 1e-5);
    EXPECT_GE(up_to, 0.5 * all - 1e-5);
  }
  EXPECT_EQ(WeightedMedianOf(MedianSamples<1>{}, SingleThread()), -1);
}

/// Two walls side by side at depths of 4 and 2, white and black.
class FilterPixelTest : public ::testing::Test {
 protected:
  static constexpr int kSize = 60, kEdge = 30;

  FilterPixelTest()
      : planes_(kSize, kSize),
        depth_(kSize, kSize),
        support_(kSize, kSize),
        color_(kSize, kSize),
        filtered_(kSize, kSize),
        cost_(kSize, kSize, 0.1f) {
    const RayGrid rays = {1 / 50.0f, 1 / 50.0f, 29.5f, 29.5f};
    for (int row = 0; row < kSize; ++row) {
      for (int col = 0; col < kSize; ++col) {
        const bool is_left = col < kEdge;
        SetDepth(col, row, is_left ? 4.0f : 2.0f);
        color_(col, row) = is_left ? Rgb{255, 255, 255} : Rgb{0, 0, 0};
      }
    }
    context_ = {rays,        1, 20, planes_.View(), depth_.View(), support_.View(), color_.View(), filtered_.View(),
                cost_.View()};
  }

  void SetDepth(int col, int row, float depth) {
    planes_(col, row) = {0, 0, -1, depth};
    depth_(col, row) = depth;
  }
  float Filtered(int col, int row) {
    WeightedMedianPixel(context_, col, row);
    return filtered_(col, row).d;
  }

  PlaneMap planes_;
  DepthMap depth_;
  Image<ViewSupport> support_;
  ColorImage color_;
  PlaneMap filtered_;
  CostMap cost_;
  MedianContext context_ = {};
};

TEST_F(FilterPixelTest, ColoursTellWhichSurfaceAPixelIsOf) {
  // The nearer one reaches four pixels too far.
  for (int row = 0; row < kSize; ++row) {
    for (int col = kEdge - 4; col < kEdge; ++col) SetDepth(col, row, 2);
  }
  for (int col = 0; col < kSize; ++col) {
    EXPECT_NEAR(Filtered(col, 30), col < kEdge ? 4 : 2, 1e-5f) << col;  // rounding of a quotient
    const bool is_changed = col >= kEdge - 4 && col < kEdge;
    EXPECT_EQ(cost_(col, 30), is_changed ? kUnverifiedCost : 0.1f) << col;
  }
  context_.color = {};
  EXPECT_NEAR(Filtered(kEdge - 2, 20), 2, 1e-5f) << "without colours most of what is around decides";
}

TEST_F(FilterPixelTest, WhatSourcesLookThroughHasLessSay) {
  // All of the left half that the filter sees from there but a column of samples has the wrong depth: nine times the
  // weight of that column, and a quarter of it for each source that violates.
  const auto filtered_with = [&](int free_space_violations) {
    for (int row = 0; row < kSize; ++row) {
      for (int col = 13; col < kEdge; ++col) {
        SetDepth(col, row, 2);
        support_(col, row) = PackViewSupport(4, 4, false, free_space_violations);
      }
    }
    return Filtered(24, 30);
  };
  EXPECT_NEAR(filtered_with(0), 2, 1e-5f);
  EXPECT_NEAR(filtered_with(1), 2, 1e-5f);
  EXPECT_NEAR(filtered_with(2), 4, 1e-5f);
  EXPECT_NEAR(filtered_with(9), 4, 1e-5f);
  for (ViewSupport& support : support_) support = PackViewSupport(4, 4, false, 3);
  EXPECT_NEAR(Filtered(24, 30), 2, 1e-5f) << "the same of all changes nothing";
}

TEST_F(FilterPixelTest, ASurfaceByItselfAndAGuessStayWhatTheyAre) {
  SetDepth(5, 30, 4.1f);  // within 5 %
  EXPECT_EQ(Filtered(5, 30), 4.1f);
  cost_(kEdge - 1, 30) = kWorstCost;
  SetDepth(kEdge - 1, 30, 2);
  EXPECT_NEAR(Filtered(kEdge - 1, 30), 4, 1e-5f);
  EXPECT_EQ(cost_(kEdge - 1, 30), kWorstCost) << "no view has confirmed it either";
}

TEST_F(FilterPixelTest, PlanesThatFaceAwayOrLeaveTheRangeAreNotExtended) {
  // Slanted by so much that twelve pixels on it would be beyond 20.
  for (int row = 0; row < kSize; ++row) {
    for (int col = 0; col < kEdge; ++col) {
      const Vec3f ray = context_.rays.Ray(static_cast<float>(col), static_cast<float>(row));
      planes_(col, row) = PlaneThrough(Normalized(Vec3f{1, 0, -0.3f}), ray, 4);
    }
  }
  context_.depth_max = 4;
  for (int col = kEdge - 6; col < kEdge; ++col) {
    const float d = Filtered(col, 30);
    EXPECT_GT(d, 0) << "a plane behind the camera is none";
    const float depth = PlaneDepth(filtered_(col, 30), context_.rays.Ray(static_cast<float>(col), 30));
    EXPECT_LE(depth, 4.0001f);
    EXPECT_GE(depth, 1.9999f);
  }
}

/// One of several group that share a pixel.
class MedianGroupThread {
 public:
  static constexpr int kSize = 4;
  using Floats = MeetingPoint<float, kSize>;
  using Ints = MeetingPoint<int, kSize>;
  MedianGroupThread(int rank, Floats* floats, Ints* ints) : rank_(rank), floats_(floats), ints_(ints) {}

  int Rank() const { return rank_; }
  float Sum(float x) const {
    const std::array<float, kSize> all = floats_->Meet(rank_, x);
    return std::accumulate(all.begin(), all.end(), 0.0f);
  }
  float Least(float x) const { return Extreme(floats_->Meet(rank_, x), std::less<float>()); }
  int Least(int x) const { return Extreme(ints_->Meet(rank_, x), std::less<int>()); }
  float Greatest(float x) const { return Extreme(floats_->Meet(rank_, x), std::greater<float>()); }

 private:
  template <class T, class Before>
  static T Extreme(const std::array<T, kSize>& all, const Before& before) {
    return *std::min_element(all.begin(), all.end(), before);
  }

  int rank_;
  Floats* floats_;
  Ints* ints_;
};

TEST_F(FilterPixelTest, FourThreadsFindWhatOneFinds) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (int row = 0; row < kSize; ++row) {
    for (int col = 0; col < kSize; ++col) {
      SetDepth(col, row, (col / 9 + row / 7) % 2 == 0 ? 2 + uniform(random) : 4 + uniform(random));
      color_(col, row) = {static_cast<uint8_t>(60 * uniform(random)), 90, static_cast<uint8_t>(col)};
      support_(col, row) = PackViewSupport(4, 4, false, static_cast<int>(random() % 3));
    }
  }
  PlaneMap expected(kSize, kSize);
  for (int row = 0; row < kSize; ++row) {
    for (int col = 0; col < kSize; ++col) {
      WeightedMedianPixel(context_, col, row);
      expected(col, row) = filtered_(col, row);
    }
  }
  const CostMap expected_cost = cost_.Clone();
  for (PlaneHypothesis& plane : filtered_) plane = {};
  for (float& cost : cost_) cost = 0.1f;
  MedianGroupThread::Floats floats;
  MedianGroupThread::Ints ints;
  OnThreads(MedianGroupThread::kSize, [&](int rank) {
    const MedianGroupThread thread(rank, &floats, &ints);
    for (int row = 0; row < kSize; ++row) {
      for (int col = 0; col < kSize; ++col) WeightedMedianPixel(context_, col, row, thread);
    }
  });
  int changed = 0, different = 0;
  for (int row = 0; row < kSize; ++row) {
    for (int col = 0; col < kSize; ++col) {
      changed += expected(col, row).d != planes_(col, row).d ? 1 : 0;
      different += filtered_(col, row).d != expected(col, row).d || cost_(col, row) != expected_cost(col, row) ? 1 : 0;
    }
  }
  EXPECT_GT(changed, kSize * kSize / 2);
  // Weights summed in another order differ by some 1e-7 of half of them: that decides between two samples where a
  // sample's share ends so close to the half, in one of some 1e5 pixels.
  EXPECT_LE(different, 1);
}

}  // namespace
}  // namespace acmp
