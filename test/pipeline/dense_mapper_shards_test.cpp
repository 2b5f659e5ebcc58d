// Several mappers that share the work and exchange estimates, against one that does it all.

#include <algorithm>
#include <cstring>
#include <map>
#include <random>
#include <set>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/evaluation/synthetic_scene.h"
#include "dense_mapper_fakes.h"
#include "hash_patch_match.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

ShardEstimate CopyOf(const ShardEstimate& estimate) {
  return {estimate.id, estimate.stage, {estimate.state.planes.Clone(), estimate.state.cost.Clone()}};
}

/// One of `shard.count` mappers; what it would send lies in `sent` until somebody delivers it.
class ShardHarness {
 public:
  ShardHarness(std::unique_ptr<DepthEngine> depth_engine, const DenseMapperOptions& options, const ShardOptions& shard)
      : engine(std::move(depth_engine)), mapper(engine.get(), options, MakeCallbacks(), shard) {}
  ShardHarness(const DenseMapperOptions& options, const ShardOptions& shard)
      : ShardHarness(std::make_unique<HostDepthEngine>(
                         [] { return std::unique_ptr<PatchMatch>(std::make_unique<HashPatchMatch>()); }),
                     options, shard) {}

  std::unique_ptr<DepthEngine> engine;
  std::map<int64_t, KeyframeDepthPtr> fast, refined;
  std::map<int64_t, std::string> drops;  ///< reasons
  std::vector<std::string> problems;
  std::vector<ShardEstimate> sent;
  DenseMapper mapper;

 private:
  DenseMapper::Callbacks MakeCallbacks() {
    DenseMapper::Callbacks callbacks;
    callbacks.on_fast = [this](const KeyframeDepthPtr& maps) {
      EXPECT_TRUE(fast.emplace(maps->frame->id, maps).second);
    };
    callbacks.on_refined = [this](const KeyframeDepthPtr& maps) {
      EXPECT_TRUE(refined.emplace(maps->frame->id, maps).second);
    };
    callbacks.on_drop = [this](const KeyframeDrop& drop) {
      EXPECT_TRUE(drops.emplace(drop.id, drop.reason).second) << drop.id;
    };
    callbacks.on_own_estimate = [this](ShardEstimate estimate) { sent.push_back(std::move(estimate)); };
    callbacks.on_problem = [this](const std::string& reason, const std::string& message) {
      problems.push_back(reason + ": " + message);
    };
    return callbacks;
  }
};

template <class T>
bool SameBits(const Image<T>& a, const Image<T>& b) {
  return a.width() == b.width() && a.height() == b.height() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

bool SamePoint(const SurfacePoint& a, const SurfacePoint& b) {
  const auto same = [](const Vec3f& u, const Vec3f& v) { return u.x == v.x && u.y == v.y && u.z == v.z; };
  return same(a.position, b.position) && same(a.normal, b.normal) && a.color.r == b.color.r && a.color.g == b.color.g &&
         a.color.b == b.color.b && a.confidence == b.confidence;
}

void ExpectSameMaps(const std::map<int64_t, KeyframeDepthPtr>& actual,
                    const std::map<int64_t, KeyframeDepthPtr>& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (const auto& [id, maps] : expected) {
    ASSERT_EQ(actual.count(id), 1u) << id;
    const KeyframeDepth& other = *actual.at(id);
    EXPECT_EQ(other.source_ids, maps->source_ids) << id;
    EXPECT_TRUE(SameBits(other.depth, maps->depth)) << id;
    EXPECT_TRUE(SameBits(other.normal, maps->normal)) << id;
    EXPECT_TRUE(SameBits(other.cost, maps->cost)) << id;
    EXPECT_TRUE(SameBits(other.confidence, maps->confidence)) << id;
    EXPECT_TRUE(std::equal(other.points_in_camera.begin(), other.points_in_camera.end(), maps->points_in_camera.begin(),
                           maps->points_in_camera.end(), &SamePoint))
        << id;
  }
}

/// Several shards and what is under way between them.
class ShardGroup {
 public:
  std::vector<std::unique_ptr<ShardHarness>> shards;

  /// Moves what has been sent since the last call under way.
  void Collect() {
    for (size_t from = 0; from < shards.size(); ++from) {
      for (ShardEstimate& estimate : shards[from]->sent) {
        for (size_t to = 0; to < shards.size(); ++to) {
          if (to != from) under_way_.push_back({to, CopyOf(estimate)});
        }
      }
      shards[from]->sent.clear();
    }
  }

  bool DeliverOne(std::mt19937* random) {
    Collect();
    if (under_way_.empty()) return false;
    const size_t which = (*random)() % under_way_.size();
    auto [to, estimate] = std::move(under_way_[which]);
    under_way_.erase(under_way_.begin() + static_cast<std::ptrdiff_t>(which));
    shards[to]->mapper.SetPeerEstimate(std::move(estimate));
    return true;
  }

  void DeliverAll(std::mt19937* random) {
    while (DeliverOne(random)) {
    }
  }

  /// All that the shards made; every keyframe must come from its own.
  template <class Value>
  std::map<int64_t, Value> Merge(std::map<int64_t, Value> ShardHarness::*member) const {
    std::map<int64_t, Value> merged;
    for (size_t i = 0; i < shards.size(); ++i) {
      for (const auto& [id, value] : (*shards[i]).*member) {
        EXPECT_EQ(static_cast<size_t>(id) % shards.size(), i) << id;
        EXPECT_TRUE(merged.emplace(id, value).second) << id;
      }
    }
    return merged;
  }

 private:
  std::vector<std::pair<size_t, ShardEstimate>> under_way_;
};

/// Feeds every shard the frames at its own pace, with estimates arriving in any order, then flushes.
void RunInAnyOrder(const std::vector<FramePtr>& frames, ShardGroup* group, std::mt19937* random) {
  std::vector<size_t> next(group->shards.size(), 0);
  size_t flushed = 0;
  while (flushed < group->shards.size()) {
    if ((*random)() % 2 == 0 && group->DeliverOne(random)) continue;
    const size_t i = (*random)() % group->shards.size();
    DenseMapper& mapper = group->shards[i]->mapper;
    // As the nodelet's worker: nobody runs away from the others.
    if (next[i] > frames.size() || mapper.waiting() >= 3) continue;
    if (next[i] == frames.size()) {
      mapper.Flush();
      ++flushed;
    } else {
      mapper.AddKeyframe(frames[next[i]]);
    }
    ++next[i];
  }
  group->DeliverAll(random);
}

TEST(DenseMapperShardsTest, MakeTheMapsOfOneMapperWhateverTheOrder) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    DenseMapperOptions options = RandomOptions(&random);
    // Few views: then a keyframe need not be a source of its own sources, and may be refined before one that reads its
    // fast estimate.
    options.source_views.max_source_views = options.min_source_views + static_cast<int>(random() % 3);
    std::vector<FramePtr> frames;
    double x = 0;
    for (int64_t id = 0; id < 30; ++id) frames.push_back(RandomFrame(id, &x, &random));
    ShardHarness single(EachOnce(options), {});
    for (const FramePtr& frame : frames) single.mapper.AddKeyframe(frame);
    single.mapper.Flush();
    EXPECT_THAT(single.sent, IsEmpty());

    ShardGroup group;
    const int count = 2 + static_cast<int>(random() % 3);
    for (int i = 0; i < count; ++i)
      group.shards.push_back(std::make_unique<ShardHarness>(options, ShardOptions{i, count}));
    RunInAnyOrder(frames, &group, &random);
    for (const auto& shard : group.shards) {
      EXPECT_EQ(shard->mapper.waiting(), 0u);
      EXPECT_EQ(shard->mapper.unfinished(), 0u);
      EXPECT_THAT(shard->problems, IsEmpty());
    }
    ExpectSameMaps(group.Merge(&ShardHarness::fast), single.fast);
    ExpectSameMaps(group.Merge(&ShardHarness::refined), single.refined);
    EXPECT_EQ(group.Merge(&ShardHarness::drops), single.drops);
  }
}

std::unique_ptr<DepthEngine> MakeFailingEngine() {
  return std::make_unique<HostDepthEngine>([] {
    auto patch_match = std::make_unique<HashPatchMatch>();
    patch_match->fails = [](int64_t id, bool geometric) { return geometric ? id % 5 == 2 : id % 7 == 3; };
    return std::unique_ptr<PatchMatch>(std::move(patch_match));
  });
}

TEST(DenseMapperShardsTest, FailuresReachTheOthersAsTheyReachNeighboursOfOneMapper) {
  std::vector<FramePtr> frames;
  for (int64_t id = 0; id < 30; ++id) frames.push_back(WallFrame(id));
  ShardHarness single(MakeFailingEngine(), FakeOptions(6, 2), {});
  for (const FramePtr& frame : frames) single.mapper.AddKeyframe(frame);
  single.mapper.Flush();
  EXPECT_THAT(single.drops, SizeIs(9));  // 3, 10, 17, 24; 2, 7, 12, 22, 27 (17 has no estimate to refine)

  std::mt19937 random(1);
  ShardGroup group;
  for (int i = 0; i < 3; ++i) {
    group.shards.push_back(std::make_unique<ShardHarness>(MakeFailingEngine(), FakeOptions(6, 2), ShardOptions{i, 3}));
  }
  RunInAnyOrder(frames, &group, &random);
  ExpectSameMaps(group.Merge(&ShardHarness::refined), single.refined);
  EXPECT_EQ(group.Merge(&ShardHarness::drops), single.drops);
}

TEST(DenseMapperShardsTest, MapTheSyntheticRoomAsOneDoes) {
  SyntheticSceneOptions scene;
  scene.width = 64;
  scene.height = 48;
  scene.keyframes = 5;
  std::vector<FramePtr> frames;
  for (SyntheticView& view : MakeSyntheticScene(scene)) {
    view.frame.id = static_cast<int64_t>(frames.size());
    frames.push_back(std::make_shared<Frame>(std::move(view.frame)));
  }
  DenseMapperOptions options;
  options.lookahead = 1;
  ShardHarness single(MakeCpuDepthEngine(), EachOnce(options), {});
  for (const FramePtr& frame : frames) single.mapper.AddKeyframe(frame);
  single.mapper.Flush();
  std::mt19937 random(1);
  ShardGroup group;
  for (int i = 0; i < 2; ++i) {
    group.shards.push_back(std::make_unique<ShardHarness>(MakeCpuDepthEngine(), options, ShardOptions{i, 2}));
  }
  RunInAnyOrder(frames, &group, &random);
  ASSERT_THAT(single.refined, SizeIs(5));
  EXPECT_FALSE(single.refined.at(2)->points_in_camera.empty());
  ExpectSameMaps(group.Merge(&ShardHarness::fast), single.fast);
  ExpectSameMaps(group.Merge(&ShardHarness::refined), single.refined);
}

TEST(DenseMapperShardsTest, EstimatesAreSentOncePerStage) {
  ShardHarness shard(FakeOptions(6, 0), {1, 2});
  for (int64_t id = 0; id < 4; ++id) shard.mapper.AddKeyframe(WallFrame(id));
  // 1 has its initial estimate; its refinement waits for 0 and 2.
  ASSERT_THAT(shard.sent, SizeIs(2));
  EXPECT_EQ(shard.sent[0].id, 1);
  EXPECT_EQ(shard.sent[0].stage, EstimateStage::kFast);
  EXPECT_EQ(shard.sent[0].state.planes.width(), kWallCamera.width);
  EXPECT_EQ(shard.sent[1].id, 3);
  EXPECT_EQ(shard.mapper.oldest_waiting(), 1);
  EXPECT_EQ(shard.mapper.unfinished(), 2u);
  shard.mapper.Reset();
  ASSERT_THAT(shard.sent, SizeIs(4));
  for (size_t i = 2; i < 4; ++i) {
    EXPECT_EQ(shard.sent[i].stage, EstimateStage::kRefined);
    EXPECT_TRUE(shard.sent[i].state.planes.empty());
  }
  EXPECT_THAT(shard.drops, ElementsAre(testing::Pair(1, "reset"), testing::Pair(3, "reset")));
  EXPECT_EQ(shard.mapper.unfinished(), 0u);
}

ShardEstimate None(int64_t id, EstimateStage stage) { return {id, stage, {}}; }

ShardEstimate Wall(int64_t id, EstimateStage stage, int width = kWallCamera.width) {
  const PlaneHypothesis wall = {0, 0, -1, static_cast<float>(kWallDepth)};
  return {id, stage, {PlaneMap(width, kWallCamera.height, wall), CostMap(width, kWallCamera.height, 0.05f)}};
}

TEST(DenseMapperShardsTest, APeerThatDropsAKeyframeIsNotWaitedFor) {
  ShardHarness shard(FakeOptions(6, 1), {1, 2});
  for (int64_t id = 0; id < 3; ++id) shard.mapper.AddKeyframe(WallFrame(id));
  EXPECT_EQ(shard.mapper.oldest_waiting(), 1);
  shard.mapper.SetPeerEstimate(None(0, EstimateStage::kFast));  // nor will there be a refined one
  EXPECT_EQ(shard.mapper.waiting(), 1u);
  shard.mapper.SetPeerEstimate(Wall(2, EstimateStage::kFast));
  EXPECT_EQ(shard.mapper.waiting(), 0u);
  EXPECT_EQ(shard.refined.count(1), 1u);
  EXPECT_THAT(shard.problems, IsEmpty());
}

TEST(DenseMapperShardsTest, NothingWaitsForAPeerThatIsLostUntilItSendsAgain) {
  ShardHarness shard(FakeOptions(6, 1), {1, 2});
  for (int64_t id = 0; id < 5; ++id) shard.mapper.AddKeyframe(WallFrame(id));
  EXPECT_EQ(shard.mapper.waiting(), 2u);  // 1 and 3
  EXPECT_THAT(shard.refined, IsEmpty());
  shard.mapper.StopWaiting();
  EXPECT_EQ(shard.mapper.waiting(), 0u);
  EXPECT_THAT(shard.refined, SizeIs(2));
  ASSERT_THAT(shard.problems, SizeIs(5));  // 1 lacks 0 and 2; 3 lacks 0, 2 and 4
  EXPECT_THAT(shard.problems[0],
              AllOf(HasSubstr("peer_estimate_missing"), HasSubstr("keyframe 1 "), HasSubstr("shard 0 of 2")));
  // Still lost.
  shard.mapper.AddKeyframe(WallFrame(5));
  shard.mapper.AddKeyframe(WallFrame(6));
  EXPECT_EQ(shard.mapper.waiting(), 0u);
  EXPECT_THAT(shard.refined, SizeIs(3));
  // And back.
  shard.mapper.SetPeerEstimate(Wall(6, EstimateStage::kFast));
  shard.mapper.AddKeyframe(WallFrame(7));
  shard.mapper.AddKeyframe(WallFrame(8));
  EXPECT_EQ(shard.mapper.oldest_waiting(), 7);
  EXPECT_EQ(shard.mapper.unfinished(), 1u);
  shard.mapper.StopWaiting();
  EXPECT_EQ(shard.mapper.unfinished(), 0u);
  shard.mapper.StopWaiting();  // nothing waits
}

TEST(DenseMapperShardsTest, BadEstimatesAreRefusedAndNotWaitedFor) {
  ShardHarness shard(FakeOptions(6, 1), {1, 2});
  EXPECT_THROW(shard.mapper.SetPeerEstimate(Wall(1, EstimateStage::kFast)), InvalidInputError);
  shard.mapper.SetPeerEstimate(Wall(0, EstimateStage::kFast, 23));  // before its keyframe
  for (int64_t id = 0; id < 3; ++id) shard.mapper.AddKeyframe(WallFrame(id));
  ASSERT_THAT(shard.problems, SizeIs(1));
  EXPECT_THAT(shard.problems[0], AllOf(HasSubstr("peer_estimate_refused"), HasSubstr("keyframe 0"),
                                       HasSubstr("shard 0"), HasSubstr("23 x 18"), HasSubstr("24 x 18")));
  shard.mapper.SetPeerEstimate(Wall(2, EstimateStage::kFast, 23));
  EXPECT_THAT(shard.problems, SizeIs(2));
  shard.mapper.SetPeerEstimate(None(0, EstimateStage::kRefined));
  EXPECT_EQ(shard.refined.count(1), 1u);
  shard.mapper.SetPeerEstimate(Wall(0, EstimateStage::kRefined));  // too late: nobody reads it
}

TEST(DenseMapperShardsTest, KeepsABoundedNumberOfEarlyEstimates) {
  ShardHarness shard(FakeOptions(4, 1), {1, 2});
  for (int64_t id = 0; id < 100; id += 2) shard.mapper.SetPeerEstimate(Wall(id, EstimateStage::kFast));
  EXPECT_THAT(shard.problems, SizeIs(50 - 2 * 4 * 2));
  EXPECT_THAT(shard.problems[0], AllOf(HasSubstr("peer_estimate_refused"), HasSubstr("keyframe 32"), HasSubstr("16")));
  for (int64_t id = 0; id < 3; ++id) shard.mapper.AddKeyframe(WallFrame(id));
  shard.mapper.SetPeerEstimate(Wall(0, EstimateStage::kRefined));
  EXPECT_EQ(shard.refined.count(1), 1u);
}

TEST(DenseMapperShardsTest, OptionsAreChecked) {
  const auto engine = MakeCpuDepthEngine();
  for (const ShardOptions& bad : {ShardOptions{2, 2}, ShardOptions{-1, 2}, ShardOptions{0, 0}, ShardOptions{0, 65}}) {
    EXPECT_THROW(DenseMapper(engine.get(), FakeOptions(4, 1), {}, bad), InvalidInputError);
  }
  ShardHarness single(FakeOptions(4, 1), {});
  EXPECT_THROW(single.mapper.SetPeerEstimate(Wall(0, EstimateStage::kFast)), InvalidInputError);
}

}  // namespace
}  // namespace acmp
