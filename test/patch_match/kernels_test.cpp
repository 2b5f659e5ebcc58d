#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "acmp_mapping/patch_match/host_functions.h"
#include "acmp_mapping/patch_match/host_passes.h"
#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/kernel/match_pairs.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "support/error_text.h"
#include "support/kernel_state.h"
#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Beyond what papers_test.cpp compares: on the optical axis a point behind a camera has the pixel of one in front.
TEST(GeometricErrorTest, PointsBehindACameraAreTruncated) {
  std::vector<PlanarView> views = RandomViews(2, 33, 27, 4);
  views[0].camera.cx = 16;
  views[0].camera.cy = 13;
  struct Case {
    double z, yaw_deg;  ///< of the source
    float seen, depth;  ///< what its map says, and what is asked about
    bool has_error;
  };
  for (const Case& c : {Case{5, 180, 8, 3, true},    // it looks back at the reference, and beyond it
                        Case{5, 180, 2, 3, false},   // at what lies before the reference
                        Case{4, 0, 1, 3, true},      // it stands beyond the point
                        Case{4, 0, 1, 5, false}}) {  // before it
    views[1].cam_from_world = LookAhead({0, 0, c.z}, c.yaw_deg, 0, 0);
    for (float& z : views[1].depth) z = c.seen;
    KernelState state(MakeProblem(views, 0, {1, 10}, true));
    const float error = GeometricError(state.Context(), c.depth, 16, 13, 0), worst = state.options().geometric_max_px;
    EXPECT_TRUE(c.has_error ? error == worst : error < 0.01f) << error << " at " << c.depth;
  }
}

TEST(RunPassTest, RefusesAStartOfAnotherSize) {
  const std::vector<PlanarView> views = RandomViews(2, 33, 27, 6);
  const PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
  const auto error = [&](int width, int cost_height) {
    EstimateState start = {PlaneMap(width, 27, {0, 0, -1, 4}), CostMap(33, cost_height, 0.5f)};
    return ErrorOf([&] { RunPass(problem, {}, Pass::kGeometric, std::move(start)); });
  };
  EXPECT_EQ(error(33, 27), "no error");
  EXPECT_THAT(error(34, 27), HasAll("planes", "34 x 27", "33 x 27"));
  EXPECT_THAT(error(33, 26), HasAll("costs", "33 x 26"));
}

TEST(PatchMatchProblemTest, NamesWhatIsWrongWithWhichView) {
  struct Case {
    std::function<void(PatchMatchProblem*)> change;
    std::vector<const char*> message;  ///< none: legal
  };
  const std::vector<PlanarView> views = RandomViews(3, 33, 27, 1);
  for (const Case& c : std::vector<Case>{
           {[](PatchMatchProblem*) {}, {}},
           {[](PatchMatchProblem* p) { p->sources.resize(32, p->sources[0]); }, {}},
           {[](PatchMatchProblem* p) { p->sources.resize(33, p->sources[0]); }, {"source views = 33", "[1, 32]"}},
           {[](PatchMatchProblem* p) { p->sources.clear(); }, {"source views = 0"}},
           {[](PatchMatchProblem* p) { p->reference.camera.fx = 0; }, {"reference view", "fx = 0"}},
           {[](PatchMatchProblem* p) { p->sources[1].camera.cy = kNan; }, {"source view 1", "cy = nan"}},
           {[](PatchMatchProblem* p) { p->reference.gray.width = 32; }, {"reference view", "32 x 27", "33 x 27"}},
           {[](PatchMatchProblem* p) { p->sources[0].gray.data = nullptr; }, {"source view 0"}},
           {[](PatchMatchProblem* p) { p->sources[1].depth.height -= 1; }, {"source view 1", "depth map"}},
           {[](PatchMatchProblem* p) { p->sources[0].cam_from_world.translation().y() = kNan; },
            {"source view 0", "pose"}},
           {[](PatchMatchProblem* p) {  // a pure rotation
              p->sources[1].cam_from_world = LookAhead({0, 0, 0}, 5, 3, 1) * p->reference.cam_from_world;
            },
            {"source view 1", "baseline"}},
           {[](PatchMatchProblem* p) {
              p->depth_range = {10, 1};
            },
            {"depth range", "[10, 1]"}},
           // Also where no baseline can be judged by it.
           {[](PatchMatchProblem* p) {
              p->depth_range = {kNan, 10};
            },
            {"depth range", "[nan, 10]"}}}) {
    PatchMatchProblem problem = MakeProblem(views, 0, {1, 10}, true);
    c.change(&problem);
    const std::string message = ErrorOf([&] { Check(problem); });
    for (const char* part : c.message) EXPECT_THAT(message, HasSubstr(part));
    EXPECT_EQ(message == "no error", c.message.empty()) << message;
  }
}

float Real(TestRandom* random, double low, double high) { return static_cast<float>((*random)(low, high)); }

/// Warps into, across the border of and past an image.
PlaneWarp RandomWarp(int width, int height, TestRandom* random) {
  return {{Real(random, -5, width + 5), Real(random, -5, height + 5), 1.0f},
          {Real(random, -1, 1), Real(random, -1, 1), Real(random, -0.05, 0.05)},
          {Real(random, -1, 1), Real(random, -1, 1), Real(random, -0.05, 0.05)}};
}

ReferencePatch RandomPatch(TestRandom* random) {
  ReferencePatch patch = {};
  for (PatchSample& sample : patch.samples) sample = {Real(random, -100, 100), Real(random, 0, 1)};
  patch.center = Real(random, 0, 255);
  return patch;
}

/// Equal bit by bit: not 0 and -0.
bool SameBits(float a, float b) {
  uint32_t bits[2];
  std::memcpy(&bits[0], &a, sizeof(a));
  std::memcpy(&bits[1], &b, sizeof(b));
  return bits[0] == bits[1];
}

bool SameBits(const WindowSums& a, const WindowSums& b) {
  return SameBits(a.ws, b.ws) && SameBits(a.wss, b.wss) && SameBits(a.wrs, b.wrs);
}

bool SameBits(const ReferencePatch& a, const ReferencePatch& b) {
  for (int i = 0; i < kPatchSamples; ++i) {
    const PatchSample &left = a.samples[i], &right = b.samples[i];
    if (!SameBits(left.value, right.value) || !SameBits(left.weight, right.weight)) return false;
  }
  return SameBits(a.center, b.center) && SameBits(a.inv_sum_weight, b.inv_sum_weight) && SameBits(a.mean, b.mean) &&
         SameBits(a.variance, b.variance);
}

const std::vector<std::pair<int, int>> kSizes = {{1, 1}, {1, 8}, {8, 1}, {2, 2}, {2, 9}, {3, 3}, {11, 11}, {31, 23}};

TEST(WindowSumsTest, AreTheSameBitsOnEveryInstructionSetAloneOrTogether) {
  const std::vector<HostFunctions> sets = SupportedHostFunctions();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (const auto& [width, height] : kSizes) {
    if (width < 2 || height < 2) continue;
    const GrayImage padded = RandomImage(width + 3, height + 2, 1);
    const ImageView<const float> image = {&padded(2, 1), width, height, width + 3};
    TestRandom random(2);
    for (int i = 0; i < 200; ++i) {
      std::vector<PlaneWarp> warps;
      for (int k = 0; k < 1 + i % kMaxHypotheses; ++k) warps.push_back(RandomWarp(width, height, &random));
      if (i % 4 == 0) warps.back().center.x = i % 8 == 0 ? kInf : kNan;
      const ReferencePatch patch = RandomPatch(&random);
      for (const HostFunctions& set : sets) {
        std::vector<WindowSums> sums(warps.size());
        set.sum_windows(image, warps.data(), static_cast<int>(warps.size()), patch, sums.data());
        for (size_t k = 0; k < warps.size(); ++k) {
          WindowSums expected;
          sets[0].sum_windows(image, &warps[k], 1, patch, &expected);
          ASSERT_TRUE(SameBits(sums[k], expected)) << set.instructions << ", window " << i << " + " << k;
        }
      }
    }
  }
}

TEST(CpuPatchTest, IsTheSameBitsOnEveryInstructionSet) {
  const std::vector<HostFunctions> sets = SupportedHostFunctions();
  for (const auto& [width, height] : kSizes) {
    const std::vector<PlanarView> views = RandomViews(2, width, height, 6);
    KernelState state(MakeProblem(views, 0, {1, 10}));
    const ImageView<const float> gray = views[0].gray.View();
    const auto patch_of = [&](const HostFunctions& set, int col, int row) {
      ReferencePatch patch;
      LoadReferencePatch(state.ContextWith(CpuSampler{{gray, &gray}, set}), col, row, state.options().sigma_color,
                         SingleThread(), &patch);
      return patch;
    };
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        for (const HostFunctions& set : sets) {
          ASSERT_TRUE(SameBits(patch_of(set, col, row), patch_of(sets[0], col, row)))
              << set.instructions << ": " << col << ", " << row;
        }
      }
    }
  }
}

/// Random planes and costs, some of these equal, of an image where some pixels are far from the border, some near.
KernelState RandomEstimate(const std::vector<PlanarView>& views) {
  KernelState state(MakeProblem(views, 0, {1, 10}));
  TestRandom random(3);
  for (PlaneHypothesis& plane : state.planes) {
    const Vec3f normal = Normalized(Vec3f{Real(&random, -1, 1), Real(&random, -1, 1), -1.0f});
    plane = {normal.x, normal.y, normal.z, Real(&random, 0.5, 9)};
  }
  for (float& cost : state.cost) cost = std::round(Real(&random, 0, 20)) / 10;
  return state;
}

TEST(HostMedianFilterTest, IsThatOfThePixelsOnEveryInstructionSet) {
  const std::vector<PlanarView> views = RandomViews(2, 31, 23, 6);
  for (const HostFunctions& set : SupportedHostFunctions()) {
    KernelState together = RandomEstimate(views), alone = RandomEstimate(views);
    const MatchContext<BilinearSampler> context = together.Context(), expected = alone.Context();
    for (int row = kMedianReach; row + kMedianReach < 23; ++row) {
      const int col = 31 - kMedianReach - 2 * set.lanes + 1;  // the last ones
      set.filter_medians(context.rays, context.depth_min, context.depth_max, col, row, context.planes);
      for (int i = 0; i < set.lanes; ++i) MedianFilterPixel(expected, col + 2 * i, row);
    }
    for (int row = 0; row < 23; ++row) {
      for (int col = 0; col < 31; ++col) {
        ASSERT_TRUE(SameBits(together.planes(col, row).d, alone.planes(col, row).d))
            << set.instructions << ": " << col << ", " << row;
      }
    }
  }
}

TEST(HostConfidencesTest, DifferInRoundingOnly) {
  TestRandom random(5);
  const ConfidenceRule rule = MakeConfidenceRule<Method::kOurs>(1, 3, {});
  constexpr int kCount = 8, kRegister = 8;
  for (int num_views = 1; num_views <= kMaxSourceViews; ++num_views) {
    std::vector<float> costs(static_cast<size_t>(kCount * num_views + kRegister), kNan);
    for (int i = 0; i < kCount * num_views; ++i) costs[static_cast<size_t>(i)] = Real(&random, 0, 2);
    const uint32_t views = 0x5b6d97e3u & AllViews(num_views);
    std::vector<float> expected(kMaxSourceViews), first(kMaxSourceViews);
    FindConfidences(BilinearSampler(), SingleThread(), costs.data(), views, num_views, kCount, rule, expected.data());
    for (const HostFunctions& set : SupportedHostFunctions()) {
      std::vector<float> found(kMaxSourceViews);
      set.find_confidences(costs.data(), views, num_views, kCount, rule, found.data());
      if (set.lanes == 4) first = found;
      for (size_t i = 0; i < found.size(); ++i) {
        EXPECT_NEAR(found[i], expected[i], 1e-6f);  // some units in the last place of exponentials of at most 1
        EXPECT_TRUE(SameBits(found[i], first[i])) << set.instructions;
      }
    }
  }
}

TEST(HostRegionsTest, HaveTheBestOfEach) {
  const std::vector<PlanarView> views = RandomViews(2, 53, 51, 6);
  KernelState state = RandomEstimate(views);
  const MatchContext<BilinearSampler> context = state.Context();
  for (const bool is_far : {false, true}) {
    const int reach = RegionReach(is_far);
    for (int row = reach; row + reach < 51; ++row) {
      for (int col = reach; col + reach < 53; ++col) {
        int best[kDirections];
        FindBestOfRegions(&context.cost(col, row), context.cost.stride, is_far, best);
        for (int i = 0; i < kDirections; ++i) {
          EXPECT_EQ(best[i], BestOfRegion(context, col, row, i + (is_far ? kDirections : 0)));
        }
      }
    }
  }
}

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
