#include <map>

#include "gtest/gtest.h"

#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/depth_metrics.h"
#include "acmp_mapping/fusion/depth_fusion.h"
#include "fusion/engine_views.h"
#include "support/devices.h"
#include "support/pass_result.h"
#include "support/scene_run.h"

// The presets end to end on the synthetic room, against its analytic depth: what the prior and the geometric passes
// bring, and that both together give the paper's order of the systems.

namespace acmp {
namespace {

constexpr int kWidth = 240, kHeight = 180, kKeyframes = 5;

/// Rendered once.
const RenderedScene& Room() {
  static const RenderedScene room({kWidth, kHeight, kKeyframes});
  return room;
}

/// What there is of one keyframe when a system is done with it.
struct Result {
  EstimateState state;
  EstimateMaps maps;
};
using Results = std::vector<Result>;  ///< one per keyframe

Results Download(DepthEngine* engine, const std::vector<EngineView>& views) {
  Results results;
  for (const EngineView& view : views) {
    results.push_back({engine->DownloadState(view.estimate), engine->Download(view.estimate)});
  }
  return results;
}

struct Quality {
  DepthMetrics all, blank, textured;
};

Quality Evaluate(const Results& results) {
  DepthErrors all, blank, textured;
  for (int i = 0; i < kKeyframes; ++i) {
    const SyntheticView& view = Room().views[i];
    Image<unsigned char> rest(kWidth, kHeight);
    for (size_t k = 0; k < rest.size(); ++k) rest.data()[k] = view.low_texture.data()[k] == 0 ? 1 : 0;
    const DepthMap& depth = results[i].maps.depth;
    all.Add(depth, view.true_depth);
    blank.Add(depth, view.true_depth, view.low_texture.View());
    textured.Add(depth, view.true_depth, rest.View());
  }
  return {all.Metrics(), blank.Metrics(), textured.Metrics()};
}

/// A system's estimates before and after its refinements.
struct System {
  System(DepthEngine* engine, const PipelineOptions& options) {
    DepthEstimator estimator(engine, options);
    std::vector<EngineView> views = LoadFrames(Room().frames, engine, 0);
    for (const KeyframeStep& step : estimator.schedule()) {
      views = TakeStep(&estimator, step, views, Room().ranges);
      if (step.kind == KeyframeStep::Kind::kInitial) initial = Download(engine, views);
    }
    refined = Download(engine, views);
  }
  Results initial, refined;
};

/// On the same footing as ACMP.
PipelineOptions AcmhWithPasses() {
  PipelineOptions options = MakePreset("acmh");
  options.geometric_passes = 2;
  return options;
}

PipelineOptions WithoutPrior() {
  PipelineOptions options = MakePreset("balanced");
  options.use_planar_prior = false;
  options.fill.enabled = false;
  options.geometric_passes = 0;
  return options;
}

/// All systems on one device, run once.
struct Systems {
  explicit Systems(DepthEngine* engine)
      : acmh(engine, AcmhWithPasses()),
        acmp(engine, MakePreset("acmp")),
        balanced(engine, MakePreset("balanced")),
        without_prior(engine, WithoutPrior()) {}
  System acmh, acmp, balanced, without_prior;
};

class PipelineSyntheticTest : public EngineTest {
 protected:
  void SetUp() override {
    EngineTest::SetUp();
    if (IsSkipped()) return;
    static std::map<Device, Systems> cache;
    auto found = cache.find(GetParam());
    if (found == cache.end()) found = cache.emplace(GetParam(), Systems(engine_.get())).first;
    systems_ = &found->second;
  }
  const Systems* systems_ = nullptr;
};

constexpr int k2Percent = 1, k5Percent = 2;  // indices into kRelativeThresholds
constexpr int k5Centimetres = 1;             // into kAbsoluteThresholds

// Shares in percent of all pixels, measured on the CPU (below 5 cm, 2 %, 5 % of depth):
//                             blank walls and floor   elsewhere          everywhere
//   ours, photometric           34.2  40.5  55.5      84.0  85.3  91.5   62.4  65.8  75.9
//   acmh                        22.8  28.7  43.6      81.4  83.5  90.9   55.9  59.7  70.4
//   acmh, two geometric passes  36.9  43.7  58.7      84.3  86.0  92.1   63.7  67.6  77.6
//   acmp_no_geometric           26.0  32.9  50.5      77.1  79.8  89.5   54.9  59.4  72.6
//   acmp                        38.9  46.2  62.2      83.3  84.9  91.6   64.0  68.1  78.8
//   balanced, before the passes 41.6  49.3  66.3      82.9  84.4  91.8   65.0  69.2  80.7
//   balanced                    61.2  67.1  80.9      88.8  89.9  95.3   76.8  80.0  89.0
// PatchMatch's random numbers move these by some tenths (another compiler is enough); the thresholds stay a third or
// more of each effect away from them.

TEST_P(PipelineSyntheticTest, MapsAreValid) {
  for (const System* system : {&systems_->acmh, &systems_->acmp, &systems_->balanced}) {
    for (int i = 0; i < kKeyframes; ++i) {
      ExpectValid(system->initial[i].state, Room().frames[i]->camera, Room().ranges[i], 2.0f);
      ExpectValid(system->refined[i].state, Room().frames[i]->camera, Room().ranges[i], 2.6f);
    }
  }
}

TEST_P(PipelineSyntheticTest, PriorHelpsOnBlankWalls) {
  const DepthMetrics without = Evaluate(systems_->without_prior.initial).blank;
  const DepthMetrics with = Evaluate(systems_->balanced.initial).blank;
  EXPECT_GT(with.below_relative[k2Percent], without.below_relative[k2Percent] + 6);
  EXPECT_GT(with.below_relative[k5Percent], without.below_relative[k5Percent] + 7);
  EXPECT_GT(with.below_absolute[k5Centimetres], without.below_absolute[k5Centimetres] + 5);
}

TEST_P(PipelineSyntheticTest, AcmpIsAboveAcmhOnBlankWallsAsInThePaper) {
  const DepthMetrics acmh = Evaluate(systems_->acmh.initial).blank,
                     no_geometric = Evaluate(systems_->acmp.initial).blank;
  EXPECT_GT(no_geometric.below_relative[k2Percent], acmh.below_relative[k2Percent] + 2.5);
  EXPECT_GT(no_geometric.below_relative[k5Percent], acmh.below_relative[k5Percent] + 4);
  const Quality acmh_refined = Evaluate(systems_->acmh.refined), acmp_refined = Evaluate(systems_->acmp.refined);
  EXPECT_GT(acmp_refined.blank.below_relative[k5Percent], acmh_refined.blank.below_relative[k5Percent] + 2);
  EXPECT_GT(acmp_refined.all.below_relative[k5Percent], acmh_refined.all.below_relative[k5Percent] + 0.5);
}

TEST_P(PipelineSyntheticTest, BalancedIsAboveThePapersSystems) {
  const Quality balanced = Evaluate(systems_->balanced.refined);
  for (const System* paper : {&systems_->acmh, &systems_->acmp}) {
    const Quality other = Evaluate(paper->refined);
    EXPECT_GT(balanced.blank.below_relative[k2Percent], other.blank.below_relative[k2Percent] + 4);
    EXPECT_GT(balanced.blank.below_relative[k5Percent], other.blank.below_relative[k5Percent] + 4);
    EXPECT_GT(balanced.blank.below_absolute[k5Centimetres], other.blank.below_absolute[k5Centimetres] + 4);
    EXPECT_GT(balanced.all.below_relative[k5Percent], other.all.below_relative[k5Percent] + 1);
  }
  EXPECT_GT(balanced.blank.below_relative[k5Percent], 67);
  EXPECT_GT(balanced.all.below_relative[k5Percent], 79);
}

TEST_P(PipelineSyntheticTest, GeometricPassesHelpAllSystems) {
  for (const System* system : {&systems_->acmh, &systems_->acmp, &systems_->balanced}) {
    const Quality before = Evaluate(system->initial), after = Evaluate(system->refined);
    EXPECT_GT(after.all.below_relative[k5Percent], before.all.below_relative[k5Percent] + 1.5);
    EXPECT_GT(after.blank.below_relative[k2Percent], before.blank.below_relative[k2Percent] + 4);
  }
}

TEST_P(PipelineSyntheticTest, FusedCloudLiesOnTheSurfaces) {
  std::vector<FusionView> views;
  std::vector<std::vector<int>> neighbors(kKeyframes);
  for (int i = 0; i < kKeyframes; ++i) {
    const Frame& frame = *Room().frames[i];
    const EstimateMaps& maps = systems_->balanced.refined[i].maps;
    views.push_back({frame.camera, frame.cam_from_world, maps.depth.View(), maps.normal.View(), maps.cost.View(),
                     frame.color.View()});
    for (int other = 0; other < kKeyframes; ++other) {
      if (other != i) neighbors[static_cast<size_t>(i)].push_back(other);
    }
  }
  FusionOptions options;
  options.min_confidence = 0.6f;  // for accuracy: the default is where F1 is best
  const PointCloud cloud = FuseViews(engine_.get(), views, neighbors, options);
  const std::vector<CloudMetrics> metrics = EvaluateCloud(cloud, Room().surface, {0.05}, 0.05);
  // Measured: 85.3 and 62.8 %; 77.3 % with the default, which keeps more of what is blank.
  EXPECT_GT(metrics[0].accuracy, 80);
  EXPECT_GT(metrics[0].completeness, 50);
}

INSTANTIATE_TEST_SUITE_P(Devices, PipelineSyntheticTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

}  // namespace
}  // namespace acmp
