#include "acmp_mapping/patch_match/kernel/update_pixel.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr double kRad = 3.14159265358979323846 / 180;

bool Same(const PlaneHypothesis& a, const PlaneHypothesis& b) {
  return a.nx == b.nx && a.ny == b.ny && a.nz == b.nz && a.d == b.d;
}

/// Random planes (and priors at two of three pixels) with their true costs, as a pass in progress has them.
template <Pass kPass>
void FillState(KernelState* state, uint32_t seed) {
  TestRandom random(seed);
  const PinholeCamera& camera = state->problem().reference.camera;
  for (int row = 0; row < state->height(); ++row) {
    for (int col = 0; col < state->width(); ++col) {
      state->planes(col, row) = RandomHypothesis(camera, col, row, 2, 8, 60, &random);
      if ((col + 2 * row) % 3 != 0) state->prior(col, row) = RandomHypothesis(camera, col, row, 3, 6, 40, &random);
    }
  }
  const auto context = state->Context();
  for (int row = 0; row < state->height(); ++row) {
    for (int col = 0; col < state->width(); ++col) {
      uint32_t mask;
      state->cost(col, row) = InitialCost<kPass>(context, col, row, state->planes(col, row), &mask);
      state->selected_views(col, row) = mask;
    }
  }
}

/// What one pixel holds.
struct Pixel {
  PlaneHypothesis plane;
  float cost;
  uint32_t mask;
};

Pixel PixelAt(const KernelState& state, int col, int row) {
  return {state.planes(col, row), state.cost(col, row), state.selected_views(col, row)};
}

struct Maps {
  explicit Maps(const KernelState& state)
      : planes(state.planes.Clone()), cost(state.cost.Clone()), selected_views(state.selected_views.Clone()) {}
  void Restore(KernelState* state) const {
    std::copy(planes.begin(), planes.end(), state->planes.begin());
    std::copy(cost.begin(), cost.end(), state->cost.begin());
    std::copy(selected_views.begin(), selected_views.end(), state->selected_views.begin());
  }
  PlaneMap planes;
  CostMap cost;
  Image<uint32_t> selected_views;
};

/// Makes every pixel of the colour but (col, row) as tempting and as poisonous as can be: least cost, invalid planes.
void PoisonSameColour(KernelState* state, int col, int row) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (int r = 0; r < state->height(); ++r) {
    for (int c = (row + col + r) % 2; c < state->width(); c += 2) {
      if (c == col && r == row) continue;
      state->planes(c, r) = {kNan, kNan, kNan, kNan};
      state->cost(c, r) = -1;
      state->selected_views(c, r) = 0x55555555u;
    }
  }
}

/// Updates single pixels with the rest of their colour intact and poisoned: only a read of it could tell.
template <class Update>
void ExpectReadsOtherColourOnly(KernelState* state, const Update& update) {
  const Maps before(*state);
  TestRandom random(5);
  for (int i = 0; i < 150; ++i) {
    const int col = random.Below(state->width()), row = random.Below(state->height());
    before.Restore(state);
    update(state->Context(), col, row);
    const Pixel clean = PixelAt(*state, col, row);
    // Written is this pixel alone.
    for (int r = 0; r < state->height(); ++r) {
      for (int c = 0; c < state->width(); ++c) {
        if (c == col && r == row) continue;
        ASSERT_TRUE(Same(state->planes(c, r), before.planes(c, r)) && state->cost(c, r) == before.cost(c, r) &&
                    state->selected_views(c, r) == before.selected_views(c, r))
            << "pixel " << col << ", " << row << " wrote to " << c << ", " << r;
      }
    }
    before.Restore(state);
    PoisonSameColour(state, col, row);
    update(state->Context(), col, row);
    const Pixel poisoned = PixelAt(*state, col, row);
    ASSERT_TRUE(Same(clean.plane, poisoned.plane) && clean.cost == poisoned.cost && clean.mask == poisoned.mask)
        << "pixel " << col << ", " << row << " read its own colour";
  }
}

template <Pass kPass>
void ExpectUpdateReadsOtherColourOnly() {
  const std::vector<PlanarView> views = RandomViews(4, 53, 55, 1);  // larger than the 47 px of the far strips
  PatchMatchOptions options;
  options.gradient_normal = true;
  KernelState state(MakeProblem(views, 0, {1, 10}, true), options);
  FillState<kPass>(&state, 2);
  ExpectReadsOtherColourOnly(&state,
                             [](const auto& context, int col, int row) { UpdatePixel<kPass>(context, col, row, 1); });
}

TEST(CheckerboardTest, PhotometricUpdateReadsTheOtherColourOnly) {
  ExpectUpdateReadsOtherColourOnly<Pass::kPhotometric>();
}
TEST(CheckerboardTest, PlanarPriorUpdateReadsTheOtherColourOnly) {
  ExpectUpdateReadsOtherColourOnly<Pass::kPlanarPrior>();
}
TEST(CheckerboardTest, GeometricUpdateReadsTheOtherColourOnly) { ExpectUpdateReadsOtherColourOnly<Pass::kGeometric>(); }

TEST(CheckerboardTest, MedianFilterReadsTheOtherColourOnly) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 1);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  FillState<Pass::kPhotometric>(&state, 2);
  ExpectReadsOtherColourOnly(&state, [](const auto& context, int col, int row) { FilterPixel(context, col, row); });
}

/// One source view: all draws go to it, so the stored cost is the cost of the stored plane.
template <Pass kPass>
struct SingleViewCase {
  SingleViewCase() : views(RandomViews(2, 53, 55, 3)), state(MakeProblem(views, 0, {1, 10}, true)) {
    FillState<kPass>(&state, 4);
  }
  /// Eq. 1 or 13 of a plane at the pixel, and eq. 7's energy where the pass has it.
  double Cost(const PlaneHypothesis& plane, int col, int row) const {
    const auto& problem = state.problem();
    double cost = reference::PhotometricCost(problem, state.options(), reference::ToDouble(plane), col, row, 0).value;
    if (kPass == Pass::kGeometric) {
      cost += 0.1 * std::min(5.0, reference::ReprojectionError(problem, Depth(plane, col, row), col, row, 0));
    }
    return cost;
  }
  double Energy(const PlaneHypothesis& plane, int col, int row) const {
    const double cost = Cost(plane, col, row);
    if (kPass != Pass::kPlanarPrior) return cost;
    const PlaneHypothesis& prior = state.prior(col, row);
    double probability = 0.5;
    if (prior.d > 0) {
      const double angle = std::acos(std::clamp(static_cast<double>(Dot(plane.normal(), prior.normal())), -1.0, 1.0));
      probability =
          reference::PriorProbability(Depth(plane, col, row) - Depth(prior, col, row), angle, 9.0 / 64, 5 * kRad, 0.5);
    }
    return reference::PriorAssistedCost(cost, probability, 0.18);
  }
  double Depth(const PlaneHypothesis& plane, int col, int row) const {
    return reference::Intersect(views[0].camera, Eigen::Vector2d(col, row), reference::ToDouble(plane)).z();
  }

  std::vector<PlanarView> views;
  KernelState state;
};

template <Pass kPass>
void ExpectUpdateTakesTheBest() {
  SingleViewCase<kPass> c;
  TestRandom random(6);
  int changed = 0, kept = 0, odd = 0;
  for (int i = 0; i < 400; ++i) {
    const int col = random.Below(53), row = random.Below(55);
    const Pixel before = PixelAt(c.state, col, row);
    const auto context = c.state.Context();
    PlaneHypothesis candidates[kNumRegions + 1];
    const Vec3f ray = context.rays.Ray(static_cast<float>(col), static_cast<float>(row));
    int count = CollectCandidates(context, col, row, ray, candidates);
    candidates[count++] = before.plane;
    UpdatePixel<kPass>(context, col, row, 0);
    const Pixel after = PixelAt(c.state, col, row);
    if (after.mask == 0) {
      ASSERT_TRUE(Same(after.plane, before.plane) && after.cost == before.cost);
      ++kept;
      continue;
    }
    ASSERT_EQ(after.mask, 1u);
    ASSERT_GT(after.plane.d, 0);
    const double depth = c.Depth(after.plane, col, row);
    ASSERT_TRUE(depth > 0.9999 && depth < 10.001) << depth;
    // Stored is eq. 1 or 13, also where eq. 7 decides (rounding: photometric_cost_test.cpp). A source pixel read on
    // the other side of a half makes 1 in 100 differ.
    odd += std::abs(after.cost - c.Cost(after.plane, col, row)) > 2e-3;
    double least = std::numeric_limits<double>::infinity();
    for (int k = 0; k < count; ++k) least = std::min(least, c.Energy(candidates[k], col, row));
    // An energy of eq. 7 has c^2 / 0.18: a cost off by 2e-3 moves it by up to 0.04.
    odd += c.Energy(after.plane, col, row) > least + (kPass == Pass::kPlanarPrior ? 0.05 : 3e-3);
    changed += !Same(after.plane, before.plane);
  }
  EXPECT_LE(odd, 4);
  EXPECT_GT(changed, 200);
  EXPECT_LT(kept, 200);
}

TEST(UpdatePixelTest, PhotometricTakesTheBestHypothesis) { ExpectUpdateTakesTheBest<Pass::kPhotometric>(); }
TEST(UpdatePixelTest, PlanarPriorTakesTheBestHypothesisByEquation7) { ExpectUpdateTakesTheBest<Pass::kPlanarPrior>(); }
TEST(UpdatePixelTest, GeometricTakesTheBestHypothesisByEquation13) { ExpectUpdateTakesTheBest<Pass::kGeometric>(); }

TEST(UpdatePixelTest, WithoutAnyDrawnViewThePixelKeepsItsHypothesis) {
  std::vector<PlanarView> views = RandomViews(4, 53, 55, 7);
  for (size_t i = 1; i < 4; ++i)
    views[i].cam_from_world = LookAhead({0.1, 0.0, 0.1 * static_cast<double>(i)}, 180, 0, 0);
  KernelState state(MakeProblem(views, 0, {1, 10}));
  FillState<Pass::kPhotometric>(&state, 8);
  for (uint32_t& mask : state.selected_views) mask = 7;
  const Maps before(state);
  for (int row = 0; row < 55; ++row) {
    for (int col = row % 2; col < 53; col += 2) {
      UpdatePixel<Pass::kPhotometric>(state.Context(), col, row, 0);
      ASSERT_TRUE(Same(state.planes(col, row), before.planes(col, row)));
      ASSERT_EQ(state.cost(col, row), before.cost(col, row));
      ASSERT_EQ(state.selected_views(col, row), 0u);  // up to date although nothing changed
    }
  }
}

/// Sampler that remembers where the source was sampled. The image is pseudo-random, so that nothing matches.
struct SpySampler {
  std::vector<Eigen::Vector2d>* positions;

  float Reference(int col, int row) const {
    return static_cast<float>(HashWord(static_cast<uint32_t>(col * 1000 + row)) % 256);
  }
  float Source(int, float x, float y) const {
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
                              const PatchMatchOptions& options) {
    positions_.clear();
    KernelState state(problem_, options);
    for (PlaneHypothesis& plane : state.planes) plane = {0, 0, -1, 5};
    const auto context = state.ContextWith(SpySampler{&positions_});
    PixelUpdate<SpySampler> pixel{
        context, 20, 15, context.rays.Ray(20, 15), LoadReferencePatch(context, 20, 15), prior, ViewWeights{}};
    pixel.weights.draws[0] = 15;
    pixel.weights.sum = 15;
    RatedHypothesis best = {current, 0, -1e9f};  // cannot be improved on
    RandomStream random(1, 2, step);
    Refine<kPass>(pixel, &random, &best);
    EXPECT_TRUE(Same(best.plane, current));
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
      const Eigen::Vector3d p(20 - 5 + 2 * (i % 6), 15 - 5 + 2 * (i / 6), 1);
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

PlaneHypothesis CurrentPlane() { return PlaneThrough(Normalized({0.2f, -0.3f, -1.0f}), {0, 0, 1}, 5.0f); }
const Eigen::Vector3d kCurrentNormal = Eigen::Vector3d(0.2, -0.3, -1.0).normalized();

TEST(RefineTest, RatesTheSixHypothesesOfEquation12) {
  RefineSpy spy;
  const PatchMatchOptions options;
  double widest_depth = 0, widest_normal = 0, nearest = 1e9, farthest = 0;
  for (uint32_t step = 0; step < 300; ++step) {
    const std::vector<Hypothesis> h = spy.Run<Pass::kPhotometric>(CurrentPlane(), {}, step, options);
    ASSERT_EQ(h.size(), 6u);
    // {[d_p, n_c], [d_r, n_c], [d_c, n_p], [d_c, n_r], [d_r, n_r], [d_p, n_p]}
    const double perturbed_depth = h[0].depth, random_depth = h[1].depth;
    const Eigen::Vector3d perturbed_normal = h[2].normal, random_normal = h[3].normal;
    for (const int i : {0, 1}) ASSERT_TRUE(SameNormal(h[i].normal, kCurrentNormal)) << i;
    for (const int i : {2, 3}) ASSERT_TRUE(SameDepth(h[i].depth, 5)) << i;
    ASSERT_TRUE(SameDepth(h[4].depth, random_depth) && SameNormal(h[4].normal, random_normal));
    ASSERT_TRUE(SameDepth(h[5].depth, perturbed_depth) && SameNormal(h[5].normal, perturbed_normal));

    ASSERT_LE(std::abs(perturbed_depth / 5 - 1), 0.02 + kDepthResolution);
    ASSERT_LE(AngleDeg(perturbed_normal, kCurrentNormal), 3 * 1.8 + kNormalResolution);
    ASSERT_TRUE(random_depth > 2 * (1 - kDepthResolution) && random_depth < 8 * (1 + kDepthResolution));
    ASSERT_LT(random_normal.z(), 0);
    widest_depth = std::max(widest_depth, std::abs(perturbed_depth / 5 - 1));
    widest_normal = std::max(widest_normal, AngleDeg(perturbed_normal, kCurrentNormal));
    nearest = std::min(nearest, random_depth);
    farthest = std::max(farthest, random_depth);
  }
  EXPECT_GT(widest_depth, 0.019);  // of 300 draws one lies in the outer 5 % but for 0.95^300
  EXPECT_GT(widest_normal, 1.8);
  EXPECT_LT(nearest, 2.1);
  EXPECT_GT(farthest, 7);
}

TEST(RefineTest, OptionsSetThePerturbations) {
  RefineSpy spy;
  PatchMatchOptions options;
  options.perturb_depth = 0.1f;
  options.perturb_normal_deg = 9;
  double widest_depth = 0, widest_normal = 0;
  for (uint32_t step = 0; step < 300; ++step) {
    const std::vector<Hypothesis> h = spy.Run<Pass::kPhotometric>(CurrentPlane(), {}, step, options);
    widest_depth = std::max(widest_depth, std::abs(h[0].depth / 5 - 1));
    widest_normal = std::max(widest_normal, AngleDeg(h[2].normal, kCurrentNormal));
  }
  EXPECT_TRUE(widest_depth > 0.095 && widest_depth < 0.1 + kDepthResolution) << widest_depth;
  EXPECT_TRUE(widest_normal > 9 && widest_normal < 27 + kNormalResolution) << widest_normal;
}

TEST(RefineTest, GradientNormalIsTheSeventh) {
  RefineSpy spy;
  PatchMatchOptions options;
  options.gradient_normal = true;
  const std::vector<Hypothesis> h = spy.Run<Pass::kPhotometric>(CurrentPlane(), {}, 0, options);
  ASSERT_EQ(h.size(), 7u);
  EXPECT_TRUE(SameDepth(h[6].depth, 5));
  EXPECT_TRUE(SameNormal(h[6].normal, {0, 0, -1}));  // the neighbours lie on a fronto-parallel plane
}

TEST(RefineTest, RandomDrawsOfThePriorPassStayNearThePrior) {
  RefineSpy spy;
  const PatchMatchOptions options;
  PixelPrior prior;
  prior.valid = true;
  prior.normal = Normalized({-0.4f, 0.1f, -1.0f});
  prior.depth = 6;
  prior.sigma_depth = 0.1f;
  prior.sigma_normal = static_cast<float>(5 * kRad);
  const Eigen::Vector3d prior_normal = Eigen::Vector3d(-0.4, 0.1, -1).normalized();
  double widest_depth = 0, widest_normal = 0;
  for (uint32_t step = 0; step < 300; ++step) {
    const std::vector<Hypothesis> h = spy.Run<Pass::kPlanarPrior>(CurrentPlane(), prior, step, options);
    ASSERT_EQ(h.size(), 6u);
    ASSERT_LE(std::abs(h[1].depth - 6), 0.3 + 6 * kDepthResolution);              // 3 sigma
    ASSERT_LE(AngleDeg(h[3].normal, prior_normal), 3 * 2.5 + kNormalResolution);  // 2.5 degrees per axis
    ASSERT_LE(std::abs(h[0].depth / 5 - 1), 0.02 + kDepthResolution);  // perturbations stay about the current one
    ASSERT_LE(AngleDeg(h[2].normal, kCurrentNormal), 3 * 1.8 + kNormalResolution);
    widest_depth = std::max(widest_depth, std::abs(h[1].depth - 6));
    widest_normal = std::max(widest_normal, AngleDeg(h[3].normal, prior_normal));
  }
  EXPECT_GT(widest_depth, 0.28);
  EXPECT_GT(widest_normal, 2.5);
}

TEST(RefineTest, WithoutPriorThePriorPassDrawsFromTheWholeRange) {
  RefineSpy spy;
  double nearest = 1e9, farthest = 0;
  for (uint32_t step = 0; step < 300; ++step) {
    const std::vector<Hypothesis> h = spy.Run<Pass::kPlanarPrior>(CurrentPlane(), {}, step, {});
    ASSERT_EQ(h.size(), 6u);
    nearest = std::min(nearest, h[1].depth);
    farthest = std::max(farthest, h[1].depth);
  }
  EXPECT_LT(nearest, 2.1);
  EXPECT_GT(farthest, 7);
}

TEST(RefineTest, NeverLeavesTheDepthRange) {
  RefineSpy spy;
  PixelPrior prior;
  prior.valid = true;
  prior.normal = {0, 0, -1};
  prior.depth = 7.9f;  // half of its draws lie beyond 8
  prior.sigma_depth = 0.5f;
  prior.sigma_normal = 0.1f;
  const PlaneHypothesis near_end = PlaneThrough({0, 0, -1}, {0, 0, 1}, 2.001f);
  size_t rated = 0;
  for (uint32_t step = 0; step < 300; ++step) {
    for (const Hypothesis& h : spy.Run<Pass::kPlanarPrior>(near_end, prior, step, {})) {
      ASSERT_GE(h.depth, 2 * (1 - kDepthResolution));
      ASSERT_LE(h.depth, 8 * (1 + kDepthResolution));
      ++rated;
    }
  }
  // About half of the random and of the perturbed depths are left out: two hypotheses each.
  EXPECT_GT(rated, 300u * 3);
  EXPECT_LT(rated, 300u * 5);
}

}  // namespace
}  // namespace acmp
