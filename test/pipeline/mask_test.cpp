#include <memory>
#include <random>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "support/devices.h"
#include "support/scene_run.h"

// Masks end to end: what they ignore leaves no trace, and with them a map is as accurate as without the thing that
// moves.

namespace acmp {
namespace {

constexpr DepthRange kRange = {0.6f, 8};

std::vector<SyntheticView> MakeRoom(bool moving_object, int width, int height, int keyframes) {
  SyntheticSceneOptions options = {width, height, keyframes};
  options.moving_object = moving_object;
  return MakeSyntheticScene(options);
}

using Frames = std::vector<FramePtr>;

/// The frames of the views, each changed by change(&frame).
template <class Change>
Frames FramesOf(const std::vector<SyntheticView>& views, const Change& change) {
  Frames frames;
  for (const SyntheticView& view : views) {
    const Frame& from = view.frame;
    auto frame = std::make_shared<Frame>();
    *frame = {from.id,
              from.stamp_s,
              from.camera,
              from.cam_from_world,
              from.color.Clone(),
              from.gray.Clone(),
              from.mask.Clone(),
              from.landmarks_in_world};
    change(frame.get());
    frames.push_back(frame);
  }
  return frames;
}

void KeepAll(Frame* /*frame*/) {}
void RemoveMask(Frame* frame) { frame->mask = {}; }

/// Other colours where the mask ignores them.
void Repaint(Frame* frame) {
  std::mt19937 random(7);
  for (size_t i = 0; i < frame->mask.size(); ++i) {
    if (frame->mask.data()[i] != 0) continue;
    frame->gray.data()[i] = static_cast<float>(random() % 256);
    frame->color.data()[i] = {static_cast<unsigned char>(random() % 256), 0, 255};
  }
}

/// What becomes of frames.
struct Map {
  std::vector<EstimateMaps> maps;
  std::vector<ConfidenceMap> confidences;
  PointCloud points;
};

class MaskTest : public EngineTest {
 protected:
  Map MakeMap(const Frames& frames, const PipelineOptions& options) {
    DepthEstimator estimator(engine_.get(), options);
    const std::vector<EngineView> views =
        TakeAllSteps(&estimator, LoadFrames(frames, engine_.get()), std::vector<DepthRange>(frames.size(), kRange));
    Map map;
    const std::unique_ptr<FusionStamps> stamps = engine_->MakeFusionStamps();
    for (size_t i = 0; i < views.size(); ++i) {
      map.maps.push_back(engine_->Download(views[i].estimate));
      map.confidences.push_back(engine_->MeasureConfidence(views[i], Others(views, i), options.fusion));
      const PointCloud points =
          engine_->FuseView(views[i], Others(views, i), options.fusion, static_cast<int>(i), stamps.get());
      map.points.insert(map.points.end(), points.begin(), points.end());
    }
    return map;
  }
};
INSTANTIATE_TEST_SUITE_P(Devices, MaskTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(MaskTest, WhatMasksIgnoreHasNoDepthAndNoInfluenceOnAnyBit) {
  const std::vector<SyntheticView> views = MakeRoom(true, 100, 75, 4);
  for (const char* preset : {"balanced", "acmp", "acmm"}) {
    SCOPED_TRACE(preset);
    const PipelineOptions options = MakePreset(preset);
    const Map map = MakeMap(FramesOf(views, KeepAll), options), repainted = MakeMap(FramesOf(views, Repaint), options);
    int ignored = 0, differing = 0, unknown = 0;
    for (size_t i = 0; i < views.size(); ++i) {
      const EstimateMaps &a = map.maps[i], &b = repainted.maps[i];
      for (size_t k = 0; k < a.depth.size(); ++k) {
        const bool is_ignored = views[i].frame.mask.data()[k] == 0;
        ignored += is_ignored ? 1 : 0;
        if (is_ignored) {
          EXPECT_EQ(a.depth.data()[k], 0);
          EXPECT_EQ(a.cost.data()[k], kWorstCost);
          EXPECT_EQ(Norm(a.normal.data()[k]), 0);
          EXPECT_EQ(map.confidences[i].data()[k], 0);
        } else {
          unknown += a.depth.data()[k] > 0 ? 0 : 1;
        }
        differing += a.depth.data()[k] != b.depth.data()[k] || a.cost.data()[k] != b.cost.data()[k] ||
                             map.confidences[i].data()[k] != repainted.confidences[i].data()[k]
                         ? 1
                         : 0;
      }
    }
    EXPECT_GT(ignored, 1000);
    EXPECT_EQ(unknown, 0) << "pixels that count have a depth";
    EXPECT_EQ(differing, 0);
    ASSERT_EQ(map.points.size(), repainted.points.size());
    for (size_t i = 0; i < map.points.size(); ++i) {
      ASSERT_EQ(map.points[i].position.z, repainted.points[i].position.z);
      ASSERT_EQ(map.points[i].color.b, repainted.points[i].color.b);
    }
  }
}

TEST_P(MaskTest, AMapWithMasksIsAsAccurateAsWithoutTheMovingObject) {
  const std::vector<SyntheticView> still = MakeRoom(false, 160, 120, 5), moving = MakeRoom(true, 160, 120, 5);
  const PointCloud surface = SampleSyntheticSurface(still, 0.02f);
  const PipelineOptions options = MakePreset("balanced");
  const auto metrics = [&](const Frames& frames) {
    return EvaluateCloud(MakeMap(frames, options).points, surface, {0.05}, 0.05).front();
  };
  const CloudMetrics without_object = metrics(FramesOf(still, KeepAll));
  const CloudMetrics masked = metrics(FramesOf(moving, KeepAll));
  const CloudMetrics unmasked = metrics(FramesOf(moving, RemoveMask));
  RecordProperty("accuracy_without_object", std::to_string(without_object.accuracy));
  RecordProperty("accuracy_masked", std::to_string(masked.accuracy));
  RecordProperty("accuracy_unmasked", std::to_string(unmasked.accuracy));
  EXPECT_GT(masked.accuracy, without_object.accuracy - 1);
  EXPECT_LT(unmasked.accuracy, without_object.accuracy - 3);
  // What the object hides in some views is seen in others, but for the middle of it.
  EXPECT_GT(masked.completeness, 0.8 * without_object.completeness);
}

}  // namespace
}  // namespace acmp
