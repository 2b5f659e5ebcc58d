#include <map>
#include <stdexcept>
#include <utility>

#include "gtest/gtest.h"

#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/evaluation/depth_metrics.h"
#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "fusion/engine_views.h"
#include "support/devices.h"
#include "support/pass_result.h"

// The presets end to end on the synthetic room, against its analytic depth: what the prior and the geometric passes
// bring, and that both together give the paper's order of the systems.

namespace acmp {
namespace {

constexpr int kWidth = 240, kHeight = 180, kKeyframes = 5;

/// The room, rendered once.
class Room {
 public:
  Room() {
    SyntheticSceneOptions options;
    options.width = kWidth;
    options.height = kHeight;
    options.keyframes = kKeyframes;
    views = MakeSyntheticScene(options);
    surface = SampleSyntheticSurface(views, 0.02f);
    for (SyntheticView& view : views) frames.push_back(std::make_shared<const Frame>(std::move(view.frame)));
    for (const FramePtr& frame : frames) {
      const auto range = DepthRangeFromLandmarks(frame->landmarks_in_world, frame->camera, frame->cam_from_world, {});
      if (!range) throw std::logic_error("the room has too few landmarks");
      ranges.push_back(*range);
    }
  }
  static const Room& Instance() {
    static const Room room;
    return room;
  }

  /// All other keyframes, the nearest in time first.
  std::vector<int> Neighbors(int index) const {
    std::vector<int> neighbors;
    for (int step = 1; step < kKeyframes; ++step) {
      for (const int other : {index - step, index + step}) {
        if (other >= 0 && other < kKeyframes) neighbors.push_back(other);
      }
    }
    return neighbors;
  }

  std::vector<SyntheticView> views;  ///< without their frames
  std::vector<FramePtr> frames;
  std::vector<DepthRange> ranges;
  PointCloud surface;
};

using Estimates = std::vector<EngineEstimatePtr>;  ///< on the device, one per keyframe

/// What there is of one keyframe when a system is done with it.
struct Result {
  EstimateState state;
  EstimateMaps maps;
};
using Results = std::vector<Result>;  ///< one per keyframe

/// The room on a device.
class RoomOnDevice {
 public:
  explicit RoomOnDevice(DepthEngine* engine) : engine_(engine) {
    for (const FramePtr& frame : Room::Instance().frames) images_.push_back(engine->Load(frame, 0));
  }

  /// A keyframe against all others. With the others' estimates, where there are any.
  EngineProblem Problem(int index, const Estimates& estimates = Estimates(kKeyframes)) const {
    const Room& room = Room::Instance();
    EngineProblem problem;
    problem.reference = {room.frames[index], images_[index], nullptr};
    for (const int other : room.Neighbors(index)) {
      problem.sources.push_back({room.frames[other], images_[other], estimates[other]});
    }
    problem.depth_range = room.ranges[index];
    return problem;
  }

  Results Download(const Estimates& estimates) const {
    Results results;
    for (const EngineEstimatePtr& estimate : estimates) {
      results.push_back({engine_->DownloadState(estimate), engine_->Download(estimate)});
    }
    return results;
  }

 private:
  DepthEngine* engine_;
  std::vector<EngineImagePtr> images_;
};

Estimates EstimateInitial(const RoomOnDevice& room, DepthEstimator* estimator) {
  Estimates estimates;
  for (int i = 0; i < kKeyframes; ++i)
    estimates.push_back(estimator->Run(estimator->schedule().front(), room.Problem(i)));
  return estimates;
}

/// Algorithm 1's geometric passes over the whole scene: each reads the depths as the one before left them.
Estimates RefineAll(const RoomOnDevice& room, DepthEstimator* estimator, Estimates estimates) {
  for (size_t step = 1; step < estimator->schedule().size(); ++step) {
    const Estimates before = estimates;
    for (int i = 0; i < kKeyframes; ++i) {
      EngineProblem problem = room.Problem(i, before);
      problem.reference.estimate = before[i];
      estimates[i] = estimator->Run(estimator->schedule()[step], problem);
    }
  }
  return estimates;
}

struct Quality {
  DepthMetrics all, blank, textured;
};

Quality Evaluate(const Results& results) {
  const Room& room = Room::Instance();
  DepthErrors all, blank, textured;
  for (int i = 0; i < kKeyframes; ++i) {
    const SyntheticView& view = room.views[i];
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
  System(const RoomOnDevice& room, DepthEngine* engine, const PipelineOptions& options) {
    DepthEstimator estimator(engine, options);
    const Estimates start = EstimateInitial(room, &estimator);
    initial = room.Download(start);
    refined = room.Download(RefineAll(room, &estimator, start));
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
  explicit Systems(DepthEngine* engine) : Systems(RoomOnDevice(engine), engine) {}
  Systems(const RoomOnDevice& room, DepthEngine* engine)
      : acmh(room, engine, AcmhWithPasses()),
        acmp(room, engine, MakePreset("acmp")),
        balanced(room, engine, MakePreset("balanced")),
        without_prior(room, engine, WithoutPrior()) {}
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
  const Room& room = Room::Instance();
  for (const System* system : {&systems_->acmh, &systems_->acmp, &systems_->balanced}) {
    for (int i = 0; i < kKeyframes; ++i) {
      ExpectValid(system->initial[i].state, room.frames[i]->camera, room.ranges[i], 2.0f);
      ExpectValid(system->refined[i].state, room.frames[i]->camera, room.ranges[i], 2.6f);
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

TEST_P(PipelineSyntheticTest, BalancedIsAboveThePapersSystemsOnBlankWalls) {
  const DepthMetrics balanced = Evaluate(systems_->balanced.refined).blank;
  for (const System* paper : {&systems_->acmh, &systems_->acmp}) {
    const DepthMetrics other = Evaluate(paper->refined).blank;
    EXPECT_GT(balanced.below_relative[k2Percent], other.below_relative[k2Percent] + 4);
    EXPECT_GT(balanced.below_relative[k5Percent], other.below_relative[k5Percent] + 4);
    EXPECT_GT(balanced.below_absolute[k5Centimetres], other.below_absolute[k5Centimetres] + 4);
  }
  EXPECT_GT(balanced.below_relative[k5Percent], 67);
}

TEST_P(PipelineSyntheticTest, BalancedIsAboveThePapersSystemsOverall) {
  const DepthMetrics balanced = Evaluate(systems_->balanced.refined).all;
  for (const System* paper : {&systems_->acmh, &systems_->acmp}) {
    EXPECT_GT(balanced.below_relative[k5Percent], Evaluate(paper->refined).all.below_relative[k5Percent] + 1);
  }
  EXPECT_GT(balanced.below_relative[k5Percent], 79);
}

TEST_P(PipelineSyntheticTest, GeometricPassesHelpAllSystems) {
  for (const System* system : {&systems_->acmh, &systems_->acmp, &systems_->balanced}) {
    const Quality before = Evaluate(system->initial), after = Evaluate(system->refined);
    EXPECT_GT(after.all.below_relative[k5Percent], before.all.below_relative[k5Percent] + 1.5);
    EXPECT_GT(after.blank.below_relative[k2Percent], before.blank.below_relative[k2Percent] + 4);
  }
}

TEST_P(PipelineSyntheticTest, PresetWithoutGeometricPassesIsTheFirstPartOfAcmp) {
  DepthEstimator estimator(engine_.get(), MakePreset("acmp_no_geometric"));
  EXPECT_EQ(estimator.options().geometric_passes, 0);
  const EngineEstimatePtr estimate =
      estimator.Run(estimator.schedule().front(), RoomOnDevice(engine_.get()).Problem(2));
  EXPECT_TRUE(SameBits(engine_->DownloadState(estimate), systems_->acmp.initial[2].state));
}

TEST_P(PipelineSyntheticTest, FusedCloudLiesOnTheSurfaces) {
  const Room& room = Room::Instance();
  std::vector<FusionView> views;
  std::vector<std::vector<int>> neighbors;
  for (int i = 0; i < kKeyframes; ++i) {
    const Frame& frame = *room.frames[i];
    const EstimateMaps& maps = systems_->balanced.refined[i].maps;
    views.push_back({frame.camera, frame.cam_from_world, maps.depth.View(), maps.normal.View(), maps.cost.View(),
                     frame.color.View()});
    neighbors.push_back(room.Neighbors(i));
  }
  FusionOptions options;
  options.min_confidence = 0.6f;  // for accuracy: the default is where F1 is best
  const PointCloud cloud = FuseViews(engine_.get(), views, neighbors, options);
  const std::vector<CloudMetrics> metrics = EvaluateCloud(cloud, room.surface, {0.05}, 0.05);
  // Measured: 85.3 and 62.8 %; 77.3 % with the default, which keeps more of what is blank.
  EXPECT_GT(metrics[0].accuracy, 80);
  EXPECT_GT(metrics[0].completeness, 50);
}

INSTANTIATE_TEST_SUITE_P(Devices, PipelineSyntheticTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

}  // namespace
}  // namespace acmp
