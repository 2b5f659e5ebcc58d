// ACMM's step between two scales: joint bilateral upsampling and the detail restorer.

#include "acmp_mapping/patch_match/kernel/restore_detail.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/host_passes.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr int kFineWidth = 33, kFineHeight = 26;  // the last column is covered by the last but one's pixel

class RestoreDetailTest : public ::testing::Test {
 protected:
  RestoreDetailTest()
      : views_(RandomViews(6, kFineWidth, kFineHeight, 5)),
        halved_(views_[0].camera.Halved()),
        state_(MakeProblem(views_, 0, {1, 10})),
        coarser_(halved_.width, halved_.height) {
    TestRandom random(7);
    for (int row = 0; row < halved_.height; ++row) {
      for (int col = 0; col < halved_.width; ++col) {
        if (random(0, 1) < 0.05) continue;  // no plane
        coarser_(col, row) = RandomHypothesis(halved_, col, row, 2, 8, 60, &random);
      }
    }
  }

  CoarserEstimate Coarser() { return {coarser_.View(), MakeRayGrid(halved_)}; }

  double CoarseDepth(int col, int row) const {
    return reference::Intersect(halved_, {1.0 * col, 1.0 * row}, reference::ToDouble(coarser_(col, row))).z();
  }

  /// Kopf et al.: sum of D_q f(|p - q|) g(|I_p - I_q|) over the sum of the weights, 5 x 5 pixels q of the coarser map.
  double UpsampledDepth(int col, int row) const {
    const GrayImage& gray = views_[0].gray;
    const Eigen::Vector2d place((col + 0.5) / 2 - 0.5, (row + 0.5) / 2 - 0.5);
    const int mid_col = std::min(col / 2, halved_.width - 1), mid_row = std::min(row / 2, halved_.height - 1);
    double sum = 0, weights = 0;
    for (int r = std::max(0, mid_row - 2); r <= std::min(halved_.height - 1, mid_row + 2); ++r) {
      for (int c = std::max(0, mid_col - 2); c <= std::min(halved_.width - 1, mid_col + 2); ++c) {
        if (!(coarser_(c, r).d > 0)) continue;
        const double distance = (Eigen::Vector2d(c, r) - place).norm();
        const double difference = gray(2 * c, 2 * r) - gray(col, row);
        const double weight =
            std::exp(-distance * distance / (2 * 0.5 * 0.5)) * std::exp(-difference * difference / (2 * 25.5 * 25.5));
        sum += weight * CoarseDepth(c, r);
        weights += weight;
      }
    }
    return sum / weights;
  }

  double Depth(const PlaneHypothesis& plane, int col, int row) const {
    return reference::Intersect(views_[0].camera, {1.0 * col, 1.0 * row}, reference::ToDouble(plane)).z();
  }

  std::vector<PlanarView> views_;
  PinholeCamera halved_;
  KernelState state_;
  PlaneMap coarser_;
};

TEST_F(RestoreDetailTest, UpsamplingAveragesDepthsByDistanceAndLikeness) {
  const auto context = state_.Context();
  for (int row = 0; row < kFineHeight; ++row) {
    for (int col = 0; col < kFineWidth; ++col) {
      const PlaneHypothesis plane = UpsampleJointly(context, Coarser(), col, row);
      ASSERT_NEAR(Depth(plane, col, row), UpsampledDepth(col, row), 2e-4) << col << ", " << row;
      const PlaneHypothesis& covering =
          coarser_(std::min(col / 2, halved_.width - 1), std::min(row / 2, halved_.height - 1));
      const Vec3f normal = covering.d > 0 ? covering.normal() : Vec3f{0, 0, -1};
      const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
      if (!(Dot(normal, ray) < -1e-3f)) continue;  // edge-on here: faces the camera instead
      ASSERT_EQ(plane.nx, normal.x);
      ASSERT_EQ(plane.ny, normal.y);
      ASSERT_EQ(plane.nz, normal.z);
    }
  }
}

TEST_F(RestoreDetailTest, WithoutAnyPlaneThereIsNothingToUpsample) {
  for (PlaneHypothesis& plane : coarser_) plane = {};
  EXPECT_EQ(UpsampleJointly(state_.Context(), Coarser(), 5, 5).d, 0);
  state_.cost(5, 5) = 1.9f;
  const PlaneHypothesis before = state_.planes(5, 5) = {0, 0, -1, 3};
  RestorePixel(state_.Context(), Coarser(), 5, 5);
  EXPECT_EQ(state_.planes(5, 5).d, before.d);
  EXPECT_EQ(state_.cost(5, 5), 1.9f);
}

/// Every pixel's own cost is set so that its upsampled plane costs more by a known amount.
TEST_F(RestoreDetailTest, OnlyWhatMatchesClearlyBetterIsADetail) {
  const auto& problem = state_.problem();
  const auto context = state_.Context();
  int compared = 0;
  for (int row = 0; row < kFineHeight; ++row) {
    for (int col = 0; col < kFineWidth; ++col) {
      const PlaneHypothesis upsampled = UpsampleJointly(context, Coarser(), col, row);
      std::vector<double> costs;
      for (int view = 0; view < 5; ++view) {
        const double cost =
            reference::PhotometricCost(problem, state_.options(), reference::ToDouble(upsampled), col, row, view).value;
        if (cost < 2) costs.push_back(cost);
      }
      std::sort(costs.begin(), costs.end());
      costs.resize(std::min<size_t>(4, costs.size()));
      if (costs.size() < 3) continue;
      double expected = 0;
      for (const double cost : costs) expected += cost / static_cast<double>(costs.size());
      for (const double margin : {0.11, 0.09, -0.3}) {
        const PlaneHypothesis own = state_.planes(col, row) = {0, 0, -1, 3};
        state_.cost(col, row) = static_cast<float>(expected - margin);
        RestorePixel(context, Coarser(), col, row);
        if (margin > 0.1) {
          ASSERT_EQ(state_.planes(col, row).d, own.d) << "a detail";
        } else {
          ASSERT_EQ(state_.planes(col, row).d, upsampled.d) << "from the coarser scale";
          ASSERT_NEAR(state_.cost(col, row), expected, 2e-3);
        }
        ++compared;
      }
    }
  }
  EXPECT_GT(compared, kFineWidth * kFineHeight);
}

TEST_F(RestoreDetailTest, MapsOfOtherSizesAreRefused) {
  const auto restore = [&](int height, const PlaneMap& coarser) {
    RestoreDetails(state_.problem(), {}, {PlaneMap(kFineWidth, height), CostMap(kFineWidth, height)}, coarser.View());
  };
  EXPECT_THROW(restore(kFineHeight, PlaneMap(kFineWidth, kFineHeight)), InvalidInputError);
  EXPECT_THROW(restore(kFineHeight - 1, coarser_), InvalidInputError);
  EXPECT_NO_THROW(restore(kFineHeight, coarser_));
}

}  // namespace
}  // namespace acmp
