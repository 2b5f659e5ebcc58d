#include "acmp_mapping/patch_match/kernel/depth_evidence.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "gtest/gtest.h"

#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr int kWidth = 60, kHeight = 44, kSources = 5;

/// A wall seen by six cameras. The sources' depths are those of the plane that is asked about, so that all agree.
class DepthEvidenceTest : public ::testing::Test {
 protected:
  /// All maps have the wall's plane with its distance from each camera multiplied, if that is 1.
  KernelState State(double factor) {
    WorldPlane plane = wall_;
    plane.d *= factor;
    for (PlanarView& view : views_) {
      view.depth = RenderPlane(plane, WaveTexture(1, 0.05, 1), view.camera, view.cam_from_world).depth;
    }
    PatchMatchProblem problem = MakeProblem(views_, 0, {1, 20}, true);
    problem.reference.mask_distance = mask_distance_.View();
    KernelState state(problem);
    const RigidTransform& camera = views_[0].cam_from_world;
    const Eigen::Vector3d normal = camera.linear() * plane.normal;
    const double d = plane.d - normal.dot(camera.translation());
    for (PlaneHypothesis& each : state.planes) {
      each = {static_cast<float>(normal.x()), static_cast<float>(normal.y()), static_cast<float>(normal.z()),
              static_cast<float>(d)};
    }
    return state;
  }

  void SetWall(double distance) {
    wall_ = WorldPlane::Slanted(12, -8, distance);
    views_ = RenderPlanarScene(wall_, kWidth, kHeight, kSources + 1);
  }

  WorldPlane wall_;
  std::vector<PlanarView> views_;
  MaskDistanceMap mask_distance_;  ///< of the reference; empty: none
};

bool IsMasked(const PatchMatchProblem& problem, int col, int row) {
  const ImageView<const unsigned char>& distance = problem.reference.mask_distance;
  return !distance.empty() && distance(col, row) == 0;
}

/// The definition in double, sample by sample, without what the reference's mask ignores; -1 where a window leaves the
/// source.
double ReferenceUnexplained(const PatchMatchProblem& problem, const reference::Plane& plane, int col, int row,
                            int view) {
  const MatchView& source = problem.sources[static_cast<size_t>(view)];
  std::vector<double> ours, theirs;
  for (int dy = -5; dy <= 5; dy += 2) {
    for (int dx = -5; dx <= 5; dx += 2) {
      const int x = std::clamp(col + dx, 0, kWidth - 1), y = std::clamp(row + dy, 0, kHeight - 1);
      double z;
      const Eigen::Vector2d at = reference::Transfer(problem.reference, source, plane, Eigen::Vector2d(x, y), &z);
      if (!(z > 0 && at.x() >= 0 && at.y() >= 0 && at.x() <= source.camera.width - 1 &&
            at.y() <= source.camera.height - 1)) {
        return -1;
      }
      if (IsMasked(problem, x, y)) continue;
      ours.push_back(problem.reference.gray(x, y));
      theirs.push_back(reference::SampleBilinear(source.gray, at.x(), at.y()));
    }
  }
  const auto covariance = [](const std::vector<double>& a, const std::vector<double>& b) {
    double mean_a = 0, mean_b = 0, sum = 0;
    const auto n = static_cast<double>(a.size());
    for (size_t i = 0; i < a.size(); ++i) mean_a += a[i] / n, mean_b += b[i] / n;
    for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - mean_a) * (b[i] - mean_b) / n;
    return sum;
  };
  const double both = std::max(covariance(ours, theirs), 0.0), variance = covariance(theirs, theirs);
  return covariance(ours, ours) - (both > 0 ? both * both / variance : 0);
}

double ReferenceEvidence(const KernelState& state, int col, int row) {
  const PatchMatchProblem& problem = state.problem();
  const reference::Plane plane = reference::ToDouble(state.planes(col, row));
  const double depth = reference::Intersect(problem.reference.camera, Eigen::Vector2d(col, row), plane).z();
  double least = INFINITY, samples = 0;
  for (int i = 0; i < 36; ++i) {
    const int x = std::clamp(col + i % 6 * 2 - 5, 0, kWidth - 1), y = std::clamp(row + i / 6 * 2 - 5, 0, kHeight - 1);
    samples += IsMasked(problem, x, y) ? 0 : 1;
  }
  std::vector<int> agreeing;
  for (int view = 0; view < kSources; ++view) {
    if (reference::ReprojectionError(problem, depth, col, row, view) < 2 &&
        ReferenceUnexplained(problem, plane, col, row, view) >= 0) {
      agreeing.push_back(view);
    }
  }
  if (agreeing.size() < 2) return 0;
  for (const double inverse : {0.9, 0.8, 0.6, 0.3, 0.01}) {
    double sum = 0;
    int compared = 0;
    for (const int view : agreeing) {
      const double here = ReferenceUnexplained(problem, plane, col, row, view);
      const double there = ReferenceUnexplained(problem, {plane.normal, plane.d / inverse}, col, row, view);
      if (there < 0) continue;
      ++compared;
      sum += std::log((there + 0.5) / (here + 0.5));
    }
    if (2 * compared < static_cast<int>(agreeing.size())) continue;
    least = std::min(least, samples / 2 * sum * static_cast<double>(agreeing.size()) / compared);
  }
  return std::isfinite(least) ? least : 0;
}

TEST_F(DepthEvidenceTest, AgreesWithTheDefinition) {
  // The third asks about a wall before one that is so far away that at the image's border less than half of the views
  // see it. In the last something moves and has its mask.
  for (const auto& [distance, factor, is_masked] :
       {std::tuple(4.0, 1.0, false), {4.0, 0.9, false}, {400.0, 0.01, false}, {4.0, 1.0, true}}) {
    SetWall(distance);
    if (is_masked) {
      Mask mask(kWidth, kHeight, 255);
      for (int row = 0; row < kHeight; ++row) {
        for (int col = row % 8; col < kWidth; col += 8) {
          mask(col, row) = 0;
          views_[0].gray(col, row) = 255 - views_[0].gray(col, row);
        }
      }
      mask_distance_ = MakeMaskDistance(mask);
    }
    KernelState state = State(factor);
    int odd = 0, positive = 0, negative = 0;
    for (int row = 0; row < kHeight; ++row) {
      for (int col = 0; col < kWidth; ++col) {
        if (IsMasked(state.problem(), col, row)) continue;  // nobody asks
        const double expected = ReferenceEvidence(state, col, row);
        const double evidence = DepthEvidence(state.Context(), col, row);
        // Where a plane fits, what is unexplained is 1e-3 of the variance of some 1000 grey levels^2: float's rounding
        // of the sums (1e-6 of them) and of positions (1e-5 px of some 20 grey levels per px) is 1e-3 of it, in each of
        // five logarithms.
        odd += std::abs(evidence - expected) > 0.2 + 1e-3 * std::abs(expected) ? 1 : 0;
        positive += expected > 10 ? 1 : 0;
        negative += expected < -10 ? 1 : 0;
      }
    }
    EXPECT_LE(odd, kWidth * kHeight / 50) << "but where rounding decides about a border or a view";
    EXPECT_GT(factor == 1 ? positive : negative, kWidth * kHeight / 2) << "factor " << factor;
  }
}

}  // namespace
}  // namespace acmp
