#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dense_mapper_fakes.h"

namespace acmp {
namespace {

/// What became of each keyframe, from the events of a harness.
struct Account {
  void Book(const std::vector<std::string>& events) {
    for (const std::string& event : events) {
      const size_t space = event.find(' ');
      const int64_t id = std::stoll(event.substr(space + 1));
      const std::string kind = event.substr(0, space);
      if (kind == "fast") {
        EXPECT_EQ(ended.count(id), 0u) << "fast after its end: " << id;
        EXPECT_TRUE(fast.insert(id).second) << "fast twice: " << id;
      } else {
        EXPECT_TRUE(ended.insert(id).second) << "ended twice: " << id;
        EXPECT_EQ(kind == "refined" && fast.count(id) == 0, false) << "refined without fast: " << id;
        if (kind == "refined") refined.insert(id);
      }
      EXPECT_EQ(added.count(id), 1u) << "never added: " << id;
    }
  }

  void BookAgain(const std::vector<int64_t>& refined_again) const {
    for (const int64_t id : refined_again) EXPECT_EQ(refined.count(id), 1u) << "again, but not once: " << id;
  }

  std::set<int64_t> added;
  std::set<int64_t> fast;
  std::set<int64_t> ended;
  std::set<int64_t> refined;
};

void FailSometimes(WallEngine* engine, StopRequest* stop, std::mt19937* random) {
  engine->before_answer = [stop, random](const WallEngine::Call&) {
    switch ((*random)() % 25) {
      case 0:
        throw ProcessingError("device lost");
      case 1:
        throw InvalidInputError("bad problem");
      case 2:
        throw std::bad_alloc();
      case 3:
        if ((*random)() % 4 == 0) stop->Request();
        break;
      default:
        break;
    }
  };
}

TEST(DenseMapperPropertyTest, EveryKeyframeEndsExactlyOnce) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    DenseMapperOptions options = RandomOptions(&random);
    MapperHarness harness(options);
    harness.keep_maps = false;
    FailSometimes(&harness.engine, &harness.stop, &random);
    Account account;
    std::vector<std::weak_ptr<const Frame>> frames;
    double x = 0;
    for (int64_t id = 0; id < 40; ++id) {
      FramePtr frame = RandomFrame(id, &x, &random);
      frames.push_back(frame);
      account.added.insert(id);
      account.Book(harness.Add(std::move(frame)));
      account.BookAgain(std::exchange(harness.refined_again, {}));
      const auto kept = std::count_if(frames.begin(), frames.end(), [](const auto& f) { return !f.expired(); });
      EXPECT_TRUE(kept <= options.window_size || harness.stop.requested()) << kept;
      EXPECT_EQ(harness.mapper.unfinished(), account.added.size() - account.ended.size());
      switch (harness.stop.requested() ? 1 : random() % 20) {
        case 0:
          account.Book(harness.Flush());
          account.BookAgain(std::exchange(harness.refined_again, {}));
          EXPECT_TRUE(harness.stop.requested() || account.ended == account.added);
          break;
        case 1:
          account.Book(harness.Reset());
          EXPECT_EQ(account.ended, account.added);
          harness.stop.Clear();
          break;
        case 2:
          options = RandomOptions(&random);
          harness.mapper.set_options(options);
          break;
        default:
          break;
      }
    }
    if (seed % 2 == 0) account.Book(harness.Flush());
    account.Book(harness.Reset());
    EXPECT_EQ(account.ended, account.added);
    EXPECT_EQ(account.ended.size(), 40u);
    for (const KeyframeDrop& drop : harness.drops) EXPECT_FALSE(drop.message.empty()) << drop.reason;
  }
}

bool SameValues(const Image<float>& a, const Image<float>& b) {
  return a.width() == b.width() && std::equal(a.begin(), a.end(), b.begin(), b.end());
}

std::vector<KeyframeDepthPtr> MapSyntheticScene(const std::vector<FramePtr>& frames) {
  DenseMapperOptions options;
  options.window_size = 5;
  options.lookahead = 1;
  HostDepthEngine engine;
  std::vector<KeyframeDepthPtr> maps;
  DenseMapper::Callbacks callbacks;
  callbacks.on_fast = [&](const KeyframeDepthPtr& depth) { maps.push_back(depth); };
  callbacks.on_refined = callbacks.on_fast;
  callbacks.on_drop = [](const KeyframeDrop& drop) { ADD_FAILURE() << drop.message; };
  DenseMapper mapper(&engine, options, callbacks);
  for (const FramePtr& frame : frames) mapper.AddKeyframe(frame);
  mapper.Flush();
  return maps;
}

/// Share of the pixels with ground truth whose depth is within 5 %.
double ShareWithin5Percent(const DepthMap& depth, const DepthMap& truth) {
  size_t good = 0, known = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (!(truth.data()[i] > 0)) continue;
    ++known;
    good += std::abs(depth.data()[i] - truth.data()[i]) < 0.05f * truth.data()[i];
  }
  return static_cast<double>(good) / static_cast<double>(known);
}

TEST(DenseMapperEndToEndTest, MapsTheSyntheticRoomAndRepeatsBitByBit) {
  SyntheticSceneOptions scene_options;
  scene_options.width = 96;
  scene_options.height = 72;
  scene_options.keyframes = 4;
  std::vector<FramePtr> frames;
  std::vector<DepthMap> truths;
  for (SyntheticView& view : MakeSyntheticScene(scene_options)) {
    frames.push_back(std::make_shared<Frame>(std::move(view.frame)));
    truths.push_back(std::move(view.true_depth));
  }
  const auto maps = MapSyntheticScene(frames);
  ASSERT_EQ(maps.size(), 8u);
  const auto again = MapSyntheticScene(frames);
  ASSERT_EQ(again.size(), 8u);
  for (size_t i = 0; i < maps.size(); ++i) {
    EXPECT_TRUE(SameValues(maps[i]->depth, again[i]->depth)) << i;
    EXPECT_TRUE(SameValues(maps[i]->cost, again[i]->cost)) << i;
    EXPECT_TRUE(SameValues(maps[i]->confidence, again[i]->confidence)) << i;
    EXPECT_EQ(maps[i]->points_in_camera.size(), again[i]->points_in_camera.size()) << i;
    if (!maps[i]->refined) continue;
    const size_t view = static_cast<size_t>(maps[i]->frame->id - frames[0]->id);
    const double share = ShareWithin5Percent(maps[i]->depth, truths[view]);
    RecordProperty(Concat("share_within_5_percent_", view), std::to_string(share));
    // Half of the room is blank and the images are small; random depths in the range would give some 10 %.
    EXPECT_GT(share, 0.5) << view;
    EXPECT_FALSE(maps[i]->points_in_camera.empty()) << view;
  }
}

}  // namespace
}  // namespace acmp
