// Labels end to end: of the synthetic room with a fifth of the pixels wrong, the map's points have the right ones.

#include <array>
#include <random>

#include "gtest/gtest.h"

#include "acmp_mapping/engine/host_depth_engine.h"
#include "acmp_mapping/geometry/vector_conversion.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {
namespace {

/// One pixel in five has another class, any of them.
LabelImage WithWrong(const LabelImage& labels, std::mt19937* random) {
  LabelImage some = labels.Clone();
  for (Label& label : some) {
    if ((*random)() % 5 != 0) continue;
    const auto other = static_cast<Label>(1 + (*random)() % (kThing - 1));
    label = other == label ? Label{kThing} : other;
  }
  return some;
}

/// Of points whose labels are the right ones.
double PercentRight(const PointCloud& points, const PointCloud& right) {
  EXPECT_EQ(points.size(), right.size());
  size_t same = 0;
  for (size_t i = 0; i < points.size(); ++i) same += points[i].label == right[i].label ? 1 : 0;
  return 100.0 * static_cast<double>(same) / static_cast<double>(points.size());
}

TEST(Labels, VotesOfViewsAndKeyframesPutThemRight) {
  const std::vector<SyntheticView> views = MakeSyntheticScene({160, 120, 8});
  std::mt19937 random(7);
  // Points with the labels that they have, with those of their pixels, and with the true ones of these.
  enum { kVoted, kOwnPixels, kTrue, kMaps };
  std::array<std::unique_ptr<MapStore>, kMaps> maps;
  for (auto& map : maps) map = std::make_unique<MapStore>(MapStoreOptions());
  std::array<PointCloud, kMaps> all;
  const auto take = [&](const KeyframeDepthPtr& depth, bool again) {
    const Frame& frame = *depth->frame;
    const KeyframeKey key = {"mapper", 1, static_cast<uint64_t>(frame.id)};
    KeyframePose pose;
    pose.stamp_ns = frame.id;
    pose.world_from_capture = depth->cam_from_world.inverse();
    std::array<PointCloud, kMaps> clouds;
    clouds.fill(depth->points_in_camera);
    for (size_t i = 0; i < depth->points_in_camera.size(); ++i) {
      const auto pixel = frame.camera.PixelOf(ToEigen(depth->points_in_camera[i].position));
      clouds[kOwnPixels][i].label = pixel ? frame.labels(pixel->x(), pixel->y()) : Label{0};
      const LabelImage& truth = views[static_cast<size_t>(frame.id)].true_labels;
      clouds[kTrue][i].label = pixel ? truth(pixel->x(), pixel->y()) : Label{0};
    }
    for (size_t k = 0; k < kMaps; ++k) {
      EXPECT_TRUE(again ? maps[k]->Replace(key, pose, clouds[k]) : maps[k]->Add(key, pose, clouds[k]));
      all[k].insert(all[k].end(), clouds[k].begin(), clouds[k].end());
    }
  };
  DenseMapper::Callbacks callbacks;
  callbacks.on_refined = [&](const KeyframeDepthPtr& depth) { take(depth, false); };
  callbacks.on_refined_again = [&](const KeyframeDepthPtr& depth) { take(depth, true); };
  DenseMapperOptions options;
  options.pipeline = MakePreset("online");
  HostDepthEngine engine;
  DenseMapper mapper(&engine, options, callbacks);
  for (const SyntheticView& view : views) {
    const Frame& frame = view.frame;
    mapper.AddKeyframe(std::make_shared<const Frame>(
        MakeFrame(frame.id, frame.stamp_s, frame.color.Clone(), frame.camera, frame.cam_from_world,
                  frame.landmarks_in_world, 0, {}, {}, WithWrong(view.true_labels, &random))));
  }
  mapper.Flush();
  std::array<PointCloud, kMaps> merged;
  for (size_t k = 0; k < kMaps; ++k) merged[k] = maps[k]->WorldCloud().points;
  ASSERT_GT(merged[kTrue].size(), 5000u);
  const double before = PercentRight(all[kOwnPixels], all[kTrue]), voted = PercentRight(all[kVoted], all[kTrue]);
  const double merged_before = PercentRight(merged[kOwnPixels], merged[kTrue]);
  const double in_map = PercentRight(merged[kVoted], merged[kTrue]);
  RecordProperty("own_pixel", std::to_string(before));
  RecordProperty("voted_by_views", std::to_string(voted));
  RecordProperty("own_pixel_in_the_map", std::to_string(merged_before));
  RecordProperty("in_the_map", std::to_string(in_map));
  EXPECT_NEAR(before, 80, 1);
  EXPECT_GT(voted, 97);
  EXPECT_GT(in_map, 97);
}

}  // namespace
}  // namespace acmp
