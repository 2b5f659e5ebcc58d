#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "support/angles.h"
#include "support/kernel_state.h"
#include "support/planar_scene.h"
#include "support/random_views.h"

// Which hypotheses the refinement rates, seen from where their windows are sampled.

namespace acmp {
namespace {

/// Sampler that remembers where the source was sampled. The image is pseudo-random, so that nothing matches.
struct SpySampler {
  using Cost = Ncc;
  std::vector<Eigen::Vector2d>* positions;

  float Reference(int col, int row) const {
    return static_cast<float>(HashWord(static_cast<uint32_t>(col * 1000 + row)) % 256);
  }
  static constexpr float kPixelCenter = 0.0f;
  static constexpr bool kHasMasks = false;
  int ImageOf(int view) const { return view; }
  float SourceAt(int, float x, float y) const {
    positions->push_back({x, y});
    return static_cast<float>(HashWord(static_cast<uint32_t>(positions->size())) % 256);
  }
};

struct Hypothesis {
  double depth;
  Eigen::Vector3d normal;
};

/// Records the hypotheses that Refine rates at pixel (20, 15), recovered from where their windows were sampled.
class RefineSpy {
 public:
  RefineSpy() {
    // A long focal length and a wide baseline make the samples' positions tell the plane to about 1e-4; the images are
    // so large that no hypothesis leaves them.
    reference_.camera = {41, 31, 400, 400, 20, 15};
    source_.camera = {100000, 100000, 4000, 4000, 50000, 50000};
    for (PlanarView* view : {&reference_, &source_}) view->gray = GrayImage(1, 1);
    source_.cam_from_world = LookAhead({1.5, 1.0, -0.2}, 0, 0, 10);
    problem_.reference = reference_.View();
    problem_.sources = {source_.View()};
    problem_.depth_range = {2, 8};
  }

  template <Pass kPass>
  std::vector<Hypothesis> Run(const PlaneHypothesis& current, const PixelPrior& prior, uint32_t step,
                              const PatchMatchOptions& options, int iteration = 0) {
    positions_.clear();
    KernelState state(problem_, options);
    for (PlaneHypothesis& plane : state.planes) plane = {0, 0, -1, 5};
    const auto context = state.ContextWith(SpySampler{&positions_});
    StackScratch scratch;
    scratch.shared.num_sources = 1;
    scratch.shared.Draws()[0] = options.view_draws;
    scratch.shared.DrawnViews()[0] = 0;
    LoadReferencePatch(context, 20, 15, context.options.sigma_color, SingleThread(), &scratch.shared.patch);
    PixelUpdate<SpySampler, SingleThread> pixel(context, 20, 15, SingleThread(), &scratch.shared);
    pixel.ray = context.rays.Ray(20, 15);
    pixel.prior = prior;
    pixel.num_drawn = 1;
    RatedHypothesis best = {current, 0, 1e9f};  // so bad that all are compared to the end
    RandomStream random(1, 2, step);
    Refine<kPass>(pixel, iteration, &random, &best);
    EXPECT_LT(best.energy, 1e9f);
    std::vector<Hypothesis> hypotheses;
    EXPECT_EQ(positions_.size() % kPatchSamples, 0u);
    for (size_t i = 0; i + kPatchSamples <= positions_.size(); i += kPatchSamples) hypotheses.push_back(Recover(i));
    return hypotheses;
  }

 private:
  /// Plane from a window of projections: with m = n / d, x ~ (A - b m^T K^-1) p is linear in m for each sample.
  Hypothesis Recover(size_t first) const {
    const Eigen::Matrix3d k_inverse = reference_.camera.K().inverse();
    const Eigen::Matrix3d a = source_.camera.K() * source_.cam_from_world.linear() * k_inverse;
    const Eigen::Vector3d b = source_.camera.K() * source_.cam_from_world.translation();
    Eigen::MatrixXd lhs(2 * kPatchSamples, 3);
    Eigen::VectorXd rhs(2 * kPatchSamples);
    for (int i = 0; i < kPatchSamples; ++i) {
      const Eigen::Vector3d p(20 + WindowCol(i), 15 + WindowRow(i), 1);
      const Eigen::Vector3d ray = k_inverse * p, projected = a * p;
      for (int axis = 0; axis < 2; ++axis) {
        const double position = positions_[first + i][axis];
        lhs.row(2 * i + axis) = (b[axis] - position * b.z()) * ray.transpose();
        rhs(2 * i + axis) = projected[axis] - position * projected.z();
      }
    }
    const Eigen::Vector3d m = lhs.colPivHouseholderQr().solve(rhs);
    return {-1 / m.dot(k_inverse * Eigen::Vector3d(20, 15, 1)), m.normalized()};
  }

  PlanarView reference_, source_;
  PatchMatchProblem problem_;
  std::vector<Eigen::Vector2d> positions_;
};

double AngleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0)) / kRad;
}

// Positions of about 50,000 px in float resolve 4e-3 px of a disparity of 1,200 px at depth 5; the window is 10 of 400
// px wide, so normals resolve to about 4e-3 / 30 rad.
constexpr double kDepthResolution = 1e-4;   // relative
constexpr double kNormalResolution = 0.08;  // degrees

bool SameDepth(double a, double b) { return std::abs(a / b - 1) < kDepthResolution; }
bool SameNormal(const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return AngleDeg(a, b) < kNormalResolution; }

PlaneHypothesis CurrentPlane() { return PlaneThrough(Normalized(Vec3f{0.2f, -0.3f, -1.0f}), {0, 0, 1}, 5.0f); }
const Eigen::Vector3d kCurrentNormal = Eigen::Vector3d(0.2, -0.3, -1.0).normalized();

/// {[d_p, n_c], [d_c, n_p], [d_p, n_p], [d_r, n_c], [d_c, n_r], [d_r, n_r]} with current, perturbed and random d, n.
enum Combination { kPerturbedDepth, kPerturbedNormal, kBothPerturbed, kRandomDepth, kRandomNormal, kBothRandom };

TEST(RefineTest, GeometricPassesPerturbOnly) {
  RefineSpy spy;
  for (uint32_t step = 0; step < 100; ++step) {
    const std::vector<Hypothesis> h = spy.Run<Pass::kGeometric>(CurrentPlane(), {}, step, {});
    ASSERT_EQ(h.size(), 3u);
    for (const Hypothesis& hypothesis : h) {
      ASSERT_LE(std::abs(hypothesis.depth / 5 - 1), 0.02 + kDepthResolution);
      ASSERT_LE(AngleDeg(hypothesis.normal, kCurrentNormal), 3 * 1.8 + kNormalResolution);
    }
    ASSERT_TRUE(SameNormal(h[kPerturbedDepth].normal, kCurrentNormal));
    ASSERT_TRUE(SameDepth(h[kPerturbedNormal].depth, 5));
  }
}

TEST(RefineTest, RandomDrawsOfThePriorPassStayNearThePrior) {
  RefineSpy spy;
  const PatchMatchOptions options;
  PixelPrior prior;
  prior.valid = true;
  prior.normal = Normalized(Vec3f{-0.4f, 0.1f, -1.0f});
  prior.depth = 6;
  prior.lambda_depth = 0.1f;
  prior.lambda_normal = static_cast<float>(5 * kRad);
  const Eigen::Vector3d prior_normal = Eigen::Vector3d(-0.4, 0.1, -1).normalized();
  double widest_depth = 0, widest_normal = 0;
  for (uint32_t step = 0; step < 300; ++step) {
    const std::vector<Hypothesis> h = spy.Run<Pass::kPlanarPrior>(CurrentPlane(), prior, step, options);
    ASSERT_EQ(h.size(), 6u);
    ASSERT_LE(std::abs(h[kRandomDepth].depth - 6), 0.3 + 6 * kDepthResolution);               // 3 sigma
    ASSERT_LE(AngleDeg(h[kRandomNormal].normal, prior_normal), 3 * 2.5 + kNormalResolution);  // 2.5 degrees per axis
    ASSERT_LE(std::abs(h[kPerturbedDepth].depth / 5 - 1),
              0.02 + kDepthResolution);  // perturbations stay about the current one
    ASSERT_LE(AngleDeg(h[kPerturbedNormal].normal, kCurrentNormal), 3 * 1.8 + kNormalResolution);
    widest_depth = std::max(widest_depth, std::abs(h[kRandomDepth].depth - 6));
    widest_normal = std::max(widest_normal, AngleDeg(h[kRandomNormal].normal, prior_normal));
  }
  EXPECT_GT(widest_depth, 0.28);
  EXPECT_GT(widest_normal, 2.5);
}

TEST(RefineTest, LaterIterationsOfThePriorPassPerturbOnly) {
  RefineSpy spy;
  PixelPrior prior;
  prior.valid = true;
  prior.normal = {0, 0, -1};
  prior.depth = 6;  // beyond what perturbing 5 reaches
  prior.lambda_depth = 0.1f;
  prior.lambda_normal = 0.1f;
  for (uint32_t step = 0; step < 100; ++step) {
    const std::vector<Hypothesis> h = spy.Run<Pass::kPlanarPrior>(CurrentPlane(), prior, step, {}, 1);
    ASSERT_EQ(h.size(), 3u);
    for (const Hypothesis& hypothesis : h) {
      ASSERT_LE(std::abs(hypothesis.depth / 5 - 1), 0.02 + kDepthResolution);
      ASSERT_LE(AngleDeg(hypothesis.normal, kCurrentNormal), 3 * 1.8 + kNormalResolution);
    }
  }
}

TEST(RefineTest, NormalsAreNeverTurnedAwayFromTheCamera) {
  // A nearly edge-on normal: half of the turns would leave the half sphere.
  const Vec3f ray = {0, 0, 1}, normal = {0.9999f, 0, -std::sqrt(1 - 0.9999f * 0.9999f)};
  int kept = 0;
  for (uint32_t pixel = 0; pixel < 2000; ++pixel) {
    RandomStream random(5, pixel, 0);
    const Vec3f turned = PerturbNormal(normal, ray, 0.1f, &random);
    ASSERT_LT(Dot(turned, ray), 0);
    kept += turned.x == normal.x && turned.y == normal.y && turned.z == normal.z ? 1 : 0;
  }
  EXPECT_GT(kept, 200);
  EXPECT_LT(kept, 1800);
}

/// Refine against the comparison of every hypothesis in every drawn view to the end.
template <Pass kPass>
void ExpectOnlyHopelessHypothesesAreLeftOut() {
  constexpr int kViews = 5;
  const std::vector<PlanarView> views = RandomViews(kViews + 1, 41, 31, 21);
  KernelState state(MakeProblem(views, 0, {1, 10}, true));
  const auto context = state.Context(static_cast<uint32_t>(kPass));
  TestRandom random(22);
  int improved = 0;
  for (int repetition = 0; repetition < 400; ++repetition) {
    const int col = random.Below(41), row = random.Below(31);
    StackScratch scratch;
    PixelScratch& shared = scratch.shared;
    shared.num_sources = kViews;
    int left = context.options.view_draws;
    for (int view = 0; view < kViews; ++view) {
      shared.Draws()[view] = view + 1 < kViews ? random.Below(left + 1) : left;
      left -= shared.Draws()[view];
    }
    const uint32_t mask = ListWeighedViews(shared.Draws(), kViews, SingleThread(), shared.DrawnViews());
    LoadReferencePatch(context, col, row, context.options.sigma_color, SingleThread(), &shared.patch);
    PixelUpdate<BilinearSampler, SingleThread> pixel(context, col, row, SingleThread(), &shared);
    pixel.ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
    pixel.num_drawn = CountBits(mask);
    if (kPass == Pass::kPlanarPrior) {
      state.prior(col, row) = RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random);
      pixel.prior = LoadPrior(context, col, row, pixel.ray);
    }
    // Energies of a bad, a middling and a good estimate.
    const RatedHypothesis start = {RandomHypothesis(views[0].camera, col, row, 2, 8, 60, &random), 0.5f,
                                   static_cast<float>(random(0.2, kPass == Pass::kPlanarPrior ? 12.0 : 1.5))};
    const RandomStream stream(1, static_cast<uint32_t>(repetition), 3);

    RandomStream own = stream;
    RatedHypothesis expected = start;
    const int count = MakeRefinements<kPass>(pixel, start.plane, 0, &own);
    const int alive = MatchWhileBelow<kPass>(pixel, count, 1e9f);
    ASSERT_EQ(alive, count);
    for (int i = 0; i < count; ++i) {
      RatePlane<kPass>(pixel, i);
      if (shared.energy[i] < expected.energy) expected = {shared.planes[i], shared.cost[i], shared.energy[i]};
    }
    own = stream;
    RatedHypothesis best = start;
    Refine<kPass>(pixel, 0, &own, &best);
    improved += best.energy < start.energy;
    ASSERT_EQ(best.energy, expected.energy);
    ASSERT_EQ(best.cost, expected.cost);
    ASSERT_EQ(best.plane.d, expected.plane.d);
  }
  EXPECT_GT(improved, 20);
  EXPECT_LT(improved, 380);
}

TEST(RefineTest, LeavesOutOnlyWhatCannotWin) {
  ExpectOnlyHopelessHypothesesAreLeftOut<Pass::kPhotometric>();
  ExpectOnlyHopelessHypothesesAreLeftOut<Pass::kPlanarPrior>();
  ExpectOnlyHopelessHypothesesAreLeftOut<Pass::kGeometric>();
}

}  // namespace
}  // namespace acmp
