// A second camera that is fixed to the first: what stands has depth, what moves has the right one.

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "support/devices.h"

namespace acmp {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kBaseline_m = 0.2;

std::vector<SyntheticView> MakeStereoRoom(int keyframes, bool standing, bool moving_object) {
  SyntheticSceneOptions options;
  options.width = 160;
  options.height = 120;
  options.keyframes = keyframes;
  options.standing = standing;
  options.moving_object = moving_object;
  options.stereo_baseline_m = kBaseline_m;
  return MakeSyntheticScene(options);
}

/// Without landmarks and mask: images and poses alone.
FramePtr CopyOf(const Frame& from, int64_t id) {
  auto frame = std::make_shared<Frame>();
  frame->id = id;
  frame->stamp_s = from.stamp_s;
  frame->camera = from.camera;
  frame->cam_from_world = from.cam_from_world;
  frame->gray = from.gray.Clone();
  return frame;
}

struct StereoMaps {
  std::vector<KeyframeDepthPtr> fast, refined;
  std::vector<std::string> drops;
};

size_t IndexOf(const KeyframeDepth& maps) { return static_cast<size_t>(maps.frame->id / 2); }

/// Shares of pixels that are right, among those that were asked for.
struct RightPixels {
  size_t asked = 0, within_2cm = 0, within_5cm = 0, within_noise = 0;

  void Add(float depth, float truth, double focal_length) {
    // Windows of 11 px match noisy pixels (1.5 grey levels) to 0.1 to 0.3 px.
    constexpr double kNoise_px = 0.3;
    ++asked;
    within_2cm += std::abs(depth - truth) < 0.02f ? 1 : 0;
    within_5cm += std::abs(depth - truth) < 0.05f ? 1 : 0;
    within_noise += depth > 0 && focal_length * kBaseline_m * std::abs(1 / depth - 1 / truth) < kNoise_px ? 1 : 0;
  }
  double Share(size_t count) const { return static_cast<double>(count) / static_cast<double>(asked); }
  std::string Describe() const {
    return Concat(asked, " px, within 2 cm ", Share(within_2cm), ", 5 cm ", Share(within_5cm), ", 0.3 px of the pair ",
                  Share(within_noise));
  }
};

/// Of the maps' pixels where counts(view, maps, i) for the i-th.
template <class Counts>
RightPixels Evaluate(const std::vector<KeyframeDepthPtr>& maps, const std::vector<SyntheticView>& views,
                     const Counts& counts) {
  RightPixels right;
  for (const KeyframeDepthPtr& m : maps) {
    const SyntheticView& view = views[IndexOf(*m)];
    const DepthMap& truth = view.shown_depth.empty() ? view.true_depth : view.shown_depth;
    for (size_t i = 0; i < truth.size(); ++i) {
      if (counts(view, *m, i)) right.Add(m->depth.data()[i], truth.data()[i], view.frame.camera.fx);
    }
  }
  return right;
}

bool IsTextured(const SyntheticView& view, const KeyframeDepth& /*maps*/, size_t i) {
  return view.low_texture.data()[i] == 0;
}
bool IsSure(const SyntheticView& /*view*/, const KeyframeDepth& maps, size_t i) {
  return maps.confidence.data()[i] >= FusionOptions().min_confidence;
}
bool IsMoving(const SyntheticView& view, const KeyframeDepth& /*maps*/, size_t i) {
  return view.frame.mask.data()[i] == 0;
}
bool IsStill(const SyntheticView& view, const KeyframeDepth& maps, size_t i) { return !IsMoving(view, maps, i); }

class CaptureTest : public EngineTest {
 protected:
  StereoMaps Map(const std::vector<SyntheticView>& views, bool with_pair, const DepthRange& range = {},
                 const char* preset = "balanced") {
    DenseMapperOptions options;
    options.pipeline = MakePreset(preset);
    options.fallback_depth_range = range;
    StereoMaps maps;
    DenseMapper::Callbacks callbacks;
    callbacks.on_fast = [&](const KeyframeDepthPtr& m) { maps.fast.push_back(m); };
    callbacks.on_refined = [&](const KeyframeDepthPtr& m) { maps.refined.push_back(m); };
    callbacks.on_drop = [&](const KeyframeDrop& drop) { maps.drops.push_back(drop.reason); };
    DenseMapper mapper(engine_.get(), options, callbacks);
    for (size_t i = 0; i < views.size(); ++i) {
      const auto id = static_cast<int64_t>(2 * i);
      Capture capture = {{CopyOf(views[i].frame, id)}, {}};
      if (with_pair) capture.companions.push_back(CopyOf(*views[i].right, id + 1));
      mapper.AddCapture(capture);
    }
    mapper.Flush();
    return maps;
  }
};
INSTANTIATE_TEST_SUITE_P(Devices, CaptureTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(CaptureTest, AStandingPairHasDepth) {
  const std::vector<SyntheticView> views = MakeStereoRoom(3, true, false);
  const StereoMaps pair = Map(views, true);
  EXPECT_THAT(pair.drops, IsEmpty());
  ASSERT_THAT(pair.refined, SizeIs(views.size()));
  const RightPixels textured = Evaluate(pair.refined, views, IsTextured), sure = Evaluate(pair.refined, views, IsSure);
  // A fifth is hidden from the other camera, outside its image, or beside a border that windows see.
  EXPECT_GT(textured.Share(textured.within_noise), 0.7) << textured.Describe();
  EXPECT_GT(sure.Share(sure.within_noise), 0.85) << sure.Describe();
  EXPECT_GT(sure.asked, 0.5 * static_cast<double>(views.size() * pair.refined[0]->depth.size()));
  const StereoMaps alone = Map(views, false);
  EXPECT_THAT(alone.refined, IsEmpty());
  EXPECT_THAT(alone.drops, SizeIs(views.size())) << "one camera that stands has none";
}

TEST_P(CaptureTest, WhatMovesHasItsDepthByThePair) {
  const std::vector<SyntheticView> views = MakeStereoRoom(6, false, true);
  constexpr DepthRange kRange = {0.6f, 8};  // matches with other images would tell that of the thing where it is not
  const StereoMaps pair = Map(views, true, kRange), alone = Map(views, false, kRange);
  ASSERT_THAT(pair.refined, SizeIs(views.size()));
  const RightPixels moving = Evaluate(pair.refined, views, IsMoving);
  const RightPixels moving_alone = Evaluate(alone.refined, views, IsMoving);
  // It goes along with the camera: for one camera alone it is farther away, in all images alike. What is left are
  // its rims.
  EXPECT_GT(moving.Share(moving.within_5cm), 0.7) << moving.Describe();
  EXPECT_LT(moving_alone.Share(moving_alone.within_5cm), 0.2) << moving_alone.Describe();
  const RightPixels still = Evaluate(pair.refined, views, IsStill);
  const RightPixels still_alone = Evaluate(alone.refined, views, IsStill);
  EXPECT_GT(still.Share(still.within_5cm), still_alone.Share(still_alone.within_5cm) - 0.02)
      << still.Describe() << "; alone: " << still_alone.Describe();
}

}  // namespace
}  // namespace acmp
