// A second camera that is fixed to the first: what stands has depth, what moves has the right one; a baseline in
// another unit is named.

#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "support/devices.h"
#include "support/error_text.h"

namespace acmp {
namespace {

constexpr double kBaseline_m = 0.2;

std::vector<SyntheticView> MakeStereoRoom(int keyframes, bool standing, bool moving_object) {
  SyntheticSceneOptions options = {160, 120, keyframes};
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
  std::vector<KeyframeDepthPtr> refined;
  std::vector<std::string> drops;
};

/// What there is of a pixel, and what is true.
struct Pixel {
  float depth, confidence, truth;
  double focal_length;  ///< px
  bool is_textured, is_moving;
};
bool IsWithin5cm(const Pixel& p) { return std::abs(p.depth - p.truth) < 0.05f; }
/// Windows of 11 px match noisy pixels (1.5 grey levels) to 0.1 to 0.3 px.
bool IsWithinNoise(const Pixel& p) {
  return p.depth > 0 && p.focal_length * kBaseline_m * std::abs(1 / p.depth - 1 / p.truth) < 0.3;
}
bool IsSure(const Pixel& p) { return p.confidence >= FusionOptions().min_confidence; }

/// Of the maps' pixels that count, the share for which it holds.
template <class Counts, class Holds>
double ShareOf(const std::vector<KeyframeDepthPtr>& maps, const std::vector<SyntheticView>& views, const Counts& counts,
               const Holds& holds) {
  size_t asked = 0, right = 0;
  for (const KeyframeDepthPtr& m : maps) {
    const SyntheticView& view = views[static_cast<size_t>(m->frame->id / 2)];
    const DepthMap& truth = view.shown_depth.empty() ? view.true_depth : view.shown_depth;
    for (size_t i = 0; i < truth.size(); ++i) {
      const bool is_moving = !view.frame.mask.empty() && view.frame.mask.data()[i] == 0;
      const Pixel pixel = {m->depth.data()[i],   m->confidence.data()[i],         truth.data()[i],
                           view.frame.camera.fx, view.low_texture.data()[i] == 0, is_moving};
      if (!counts(pixel)) continue;
      ++asked;
      right += holds(pixel) ? 1 : 0;
    }
  }
  return static_cast<double>(right) / static_cast<double>(asked);
}

class CaptureTest : public EngineTest {
 protected:
  StereoMaps Map(const std::vector<SyntheticView>& views, bool with_pair, const DepthRange& range = {}) {
    DenseMapperOptions options;
    options.pipeline = MakePreset("balanced");
    options.fallback_depth_range = range;
    StereoMaps maps;
    DenseMapper::Callbacks callbacks;
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
  // A fifth is hidden from the other camera, outside its image, or beside a border that windows see.
  EXPECT_GT(ShareOf(
                pair.refined, views, [](const Pixel& p) { return p.is_textured; }, IsWithinNoise),
            0.7);
  EXPECT_GT(ShareOf(pair.refined, views, IsSure, IsWithinNoise), 0.85);
  EXPECT_GT(ShareOf(
                pair.refined, views, [](const Pixel&) { return true; }, IsSure),
            0.5);
  const StereoMaps alone = Map(views, false);
  EXPECT_THAT(alone.refined, IsEmpty());
  EXPECT_THAT(alone.drops, SizeIs(views.size())) << "one camera that stands has none";
}

TEST_P(CaptureTest, WhatMovesHasItsDepthByThePair) {
  const std::vector<SyntheticView> views = MakeStereoRoom(6, false, true);
  constexpr DepthRange kRange = {0.6f, 8};  // matches with other images would tell that of the thing where it is not
  const StereoMaps pair = Map(views, true, kRange), alone = Map(views, false, kRange);
  ASSERT_THAT(pair.refined, SizeIs(views.size()));
  const auto moving = [](const Pixel& p) { return p.is_moving; };
  const auto still = [](const Pixel& p) { return !p.is_moving; };
  // It goes along with the camera: for one camera alone it is farther away, in all images alike. What is left are
  // its rims.
  EXPECT_GT(ShareOf(pair.refined, views, moving, IsWithin5cm), 0.7);
  EXPECT_LT(ShareOf(alone.refined, views, moving, IsWithin5cm), 0.2);
  EXPECT_GT(ShareOf(pair.refined, views, still, IsWithin5cm), ShareOf(alone.refined, views, still, IsWithin5cm) - 0.02);
}

}  // namespace
}  // namespace acmp
