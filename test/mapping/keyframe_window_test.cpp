// What enters the window, fails there, is kept, and leaves it; and the preset that a machine keeps up with.

#include <cmath>
#include <limits>
#include <new>

#include "acmp_mapping/mapping/auto_preset.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "dense_mapper_fakes.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using Strings = std::vector<std::string>;

TEST(DenseMapperFlushTest, OneViewIsEnough) {
  MapperHarness harness(FakeOptions(6, 2));
  harness.Add(WallFrame(0));
  harness.Add(WallFrame(1));
  EXPECT_THAT(harness.Flush(), ElementsAre("fast 0", "fast 1", "refined 0", "refined 1"));
  // And it goes on afterwards with what is in the window.
  EXPECT_THAT(harness.Add(WallFrame(2)), ElementsAre("fast 2"));
}

TEST(DenseMapperFlushTest, ALoneKeyframeIsDropped) {
  MapperHarness harness(FakeOptions(6, 2));
  EXPECT_THAT(harness.Flush(), IsEmpty());
  harness.Add(WallFrame(3));
  EXPECT_THAT(harness.Flush(), ElementsAre("drop 3 no_source_views"));
  EXPECT_THAT(harness.drops[0].message, HasAll("keyframe 3", "no other keyframe"));
  EXPECT_FALSE(harness.drops[0].had_fast);
  // It still serves as a source view of later ones.
  harness.Add(WallFrame(4));
  EXPECT_THAT(harness.Add(WallFrame(5)), ElementsAre("fast 4", "fast 5"));
}

TEST(DenseMapperSourceImageTest, IsMatchedAgainstAndGetsNoMaps) {
  MapperHarness harness(FakeOptions(6, 2));
  harness.AddSourceImage(WallFrame(0));
  harness.AddSourceImage(WallFrame(1));
  EXPECT_THAT(harness.TakeEvents(), IsEmpty());
  EXPECT_THAT(harness.Add(WallFrame(2)), ElementsAre("fast 2"));
  EXPECT_THAT(harness.engine.calls.back().sources, UnorderedElementsAre(0, 1));
  harness.AddSourceImage(WallFrame(3));
  EXPECT_THAT(harness.TakeEvents(), IsEmpty());
  harness.AddSourceImage(WallFrame(4));
  EXPECT_THAT(harness.TakeEvents(), ElementsAre("refined 2")) << "they are later keyframes to those that wait";
  EXPECT_THAT(harness.Flush(), IsEmpty());
}

TEST(DenseMapperResetTest, AccountsForEverythingAndForgetsIt) {
  MapperHarness harness(FakeOptions(6, 2));
  for (int id = 10; id <= 13; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(harness.Reset(), ElementsAre("drop 12 reset", "drop 13 reset"));
  EXPECT_TRUE(harness.drops[0].had_fast);
  EXPECT_THAT(harness.drops[0].message, HasSubstr("keyframe 12"));
  EXPECT_THAT(harness.Reset(), IsEmpty());
  // Ids may start again, e.g. when a bag loops; the depth range is forgotten.
  EXPECT_THAT(harness.Add(WallFrame(1, 0.35, {})), ElementsAre("drop 1 no_depth_range"));
}

TEST(DenseMapperIdTest, MustAscend) {
  MapperHarness harness(FakeOptions(6, 2));
  harness.Add(WallFrame(5));
  for (const int64_t id : {5, 4, -1})
    EXPECT_REFUSED(harness.mapper.AddKeyframe(WallFrame(id)), Concat("id = ", id), "5");
  EXPECT_THROW(harness.mapper.AddKeyframe(nullptr), InvalidInputError);
  harness.Add(WallFrame(100, 2.1));
  EXPECT_THAT(harness.Add(WallFrame(101, 2.45)), ElementsAre("fast 5", "fast 100", "fast 101", "refined 5"));
}

TEST(DenseMapperIdenticalPosesTest, DropsWithTheReasonWhenTheyLeaveTheWindow) {
  MapperHarness harness(FakeOptions(3, 1));
  for (int id = 0; id < 3; ++id) EXPECT_THAT(harness.Add(WallFrame(id, 1.0)), IsEmpty());
  EXPECT_THAT(harness.Add(WallFrame(3, 1.0)), ElementsAre("drop 0 no_source_views"));
  EXPECT_THAT(harness.drops[0].message, HasAll("keyframe 0", "0 of 2", "2 with no baseline"));
  EXPECT_THAT(harness.Flush(),
              ElementsAre("drop 1 no_source_views", "drop 2 no_source_views", "drop 3 no_source_views"));
  EXPECT_THAT(harness.engine.calls, IsEmpty());
}

TEST(DenseMapperIdenticalPosesTest, GoesOnOnceTheCameraMoves) {
  MapperHarness harness(FakeOptions(5, 1));
  for (int id = 0; id < 3; ++id) harness.Add(WallFrame(id, 1.0));
  EXPECT_THAT(harness.Add(WallFrame(3, 1.4)), ElementsAre("fast 3"));
  EXPECT_THAT(harness.Add(WallFrame(4, 1.8)),
              ElementsAre("fast 0", "fast 1", "fast 2", "fast 4", "refined 0", "refined 1", "refined 2", "refined 3"));
  // Views at the same place never count as sources.
  EXPECT_THAT(CallsOf(harness.engine, "photometric", 0)[0].sources, UnorderedElementsAre(3, 4));
}

TEST(DenseMapperDepthRangeTest, FallsBackToTheLastThenToTheOptions) {
  DenseMapperOptions options = FakeOptions(6, 2);
  options.fallback_depth_range = {1, 50};
  MapperHarness harness(options);
  harness.Add(WallFrame(0, 0, {}));
  harness.Add(WallFrame(1));
  harness.Add(WallFrame(2, 0.7, {}));
  ASSERT_THAT(harness.fast, SizeIs(3));
  EXPECT_EQ(harness.fast[0]->range.max, 50);
  const auto from_landmarks = static_cast<float>(kWallDepth * kDepthMargin);
  EXPECT_FLOAT_EQ(harness.fast[1]->range.max, from_landmarks);
  EXPECT_FLOAT_EQ(harness.fast[2]->range.max, from_landmarks);
}

TEST(DenseMapperDepthRangeTest, DropsWithoutAny) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::vector<Eigen::Vector3d>> clouds = {
      {},
      std::vector<Eigen::Vector3d>(100, {nan, nan, nan}),
      std::vector<Eigen::Vector3d>(100, {0, 0, 0}),
      std::vector<Eigen::Vector3d>(100, {0, 0, -5}),
      std::vector<Eigen::Vector3d>(100, {500, 0, 5}),
  };
  MapperHarness harness(FakeOptions(10, 2));
  for (size_t i = 0; i < clouds.size(); ++i) {
    const auto id = static_cast<int64_t>(i);
    EXPECT_THAT(harness.Add(WallFrame(id, 0.35 * static_cast<double>(i), clouds[i])),
                ElementsAre(Concat("drop ", i, " no_depth_range")));
    EXPECT_THAT(harness.drops.back().message,
                HasAll(Concat("keyframe ", i),
                       clouds[i].empty() ? "no sparse points" : Concat(clouds[i].size(), " sparse points"),
                       "set depth_min and depth_max"));
  }
  // They are source views all the same: the first keyframe with landmarks needs no further ones.
  EXPECT_THAT(harness.Add(WallFrame(5)), ElementsAre("fast 5"));
  EXPECT_THAT(harness.Add(WallFrame(6, 2.1, {})), ElementsAre("fast 6"));
}

TEST(DenseMapperFailureTest, OfAnEstimateDropsThatKeyframeOnly) {
  const auto run = [](const std::function<void()>& fail) {
    MapperHarness harness(FakeOptions(6, 1));
    harness.engine.before_answer = [&](const WallEngine::Call& call) {
      if (call.reference == 3) fail();
    };
    Strings events;
    for (int id = 0; id <= 5; ++id) {
      for (const std::string& event : harness.Add(WallFrame(id))) events.push_back(event);
    }
    EXPECT_THAT(harness.drops, SizeIs(1));
    EXPECT_FALSE(harness.drops[0].had_fast);
    EXPECT_THAT(CallsOf(harness.engine, "photometric", 5)[0].sources, Contains(3));
    const std::string message = harness.drops[0].message;
    EXPECT_THAT(harness.Reset(), ElementsAre("drop 5 reset")) << "all others have ended";
    return std::make_pair(events, message);
  };
  const auto expected = [](const std::string& reason) {
    return ElementsAre("fast 0", "fast 1", "fast 2", "refined 0", "refined 1", "drop 3 " + reason, "refined 2",
                       "fast 4", "fast 5", "refined 4");
  };
  const auto device = run([] { throw ProcessingError("device lost"); });
  EXPECT_THAT(device.first, expected("processing_error"));
  EXPECT_THAT(device.second, HasSubstr("device lost"));
  const auto input = run([] { throw InvalidInputError("x = 1: must be 2"); });
  EXPECT_THAT(input.first, expected("invalid_input"));
  EXPECT_THAT(input.second, HasSubstr("x = 1"));
  const auto memory = run([] { throw std::bad_alloc(); });
  EXPECT_THAT(memory.first, expected("processing_error"));
  EXPECT_THAT(memory.second, HasSubstr("memory"));
}

TEST(DenseMapperFailureTest, OfARefinementKeepsTheFastMapForOthers) {
  MapperHarness harness(FakeOptions(8, 3));
  harness.engine.before_answer = [](const WallEngine::Call& call) {
    if (call.reference == 2 && call.pass == "geometric") throw ProcessingError("device lost");
  };
  for (int id = 0; id <= 6; ++id) harness.Add(WallFrame(id));
  ASSERT_THAT(harness.drops, SizeIs(1));
  EXPECT_EQ(harness.drops[0].frame->id, 2);
  EXPECT_TRUE(harness.drops[0].had_fast);
  const auto call = CallsOf(harness.engine, "geometric", 3)[0];
  for (size_t j = 0; j < call.sources.size(); ++j) {
    EXPECT_FLOAT_EQ(call.source_depths[j], call.sources[j] <= 1 ? kRefinedDepth : kFastDepth);
  }
}

TEST(DenseMapperFailureTest, BadFramesAreRefusedAndNeverBecomeSources) {
  MapperHarness harness(FakeOptions(10, 1));
  harness.Add(WallFrame(0));
  const std::vector<std::pair<std::function<void(Frame*)>, std::string>> cases = {
      {[](Frame* frame) { frame->cam_from_world.translation().y() = std::nan(""); }, "not finite"},
      {[](Frame* frame) { frame->gray = GrayImage(23, 18); }, "23 x 18"},
      {[](Frame* frame) { frame->color = ColorImage(1, 1); }, "1 x 1"},
      {[](Frame* frame) { frame->camera.fx = 0; }, "fx"},
      {[](Frame* frame) { frame->mask = Mask(18, 24, 255); }, "mask size 18 x 24"},
      {[](Frame* frame) { frame->mask = Mask(24, 18); }, "ignores every pixel"},
  };
  int64_t id = 0;
  for (const auto& [spoil, named] : cases) {
    Frame frame = MakeWallFrame(++id, 0.7);
    spoil(&frame);
    const auto bad = std::make_shared<Frame>(std::move(frame));
    EXPECT_THAT(harness.Add(bad), ElementsAre(Concat("drop ", id, " invalid_input")));
    EXPECT_THAT(harness.drops.back().message, HasAll(Concat("keyframe ", id), named));
  }
  Frame source = MakeWallFrame(++id, 0.7);
  source.camera.fx = 0;
  EXPECT_THROW(harness.AddSourceImage(std::make_shared<Frame>(std::move(source))), InvalidInputError);
  harness.Add(WallFrame(++id, 0.5));
  EXPECT_THAT(harness.Add(WallFrame(++id, 1.0)), Contains(Concat("fast ", id)));
  EXPECT_THAT(CallsOf(harness.engine, "photometric", id)[0].sources, UnorderedElementsAre(0, id - 1));
}

TEST(DenseMapperEvictionTest, RefinesOrDropsWhatLeavesAShrunkenWindow) {
  MapperHarness harness(FakeOptions(8, 7));
  for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id));
  harness.mapper.set_options(FakeOptions(3, 2));
  // 0, 1 and 2 leave, with the estimates they have; 3 has only one later keyframe.
  EXPECT_THAT(harness.Add(WallFrame(5)), ElementsAre("refined 0", "refined 1", "refined 2", "fast 5", "refined 3"));
}

TEST(DenseMapperEvictionTest, RefinementWithoutAnyViewLeftIsReported) {
  MapperHarness harness(FakeOptions(2, 1, 1));
  harness.Add(WallFrame(0, 0));
  harness.Add(WallFrame(1, 0.35));
  // 2 stands where 1 stands: 1 has its fast map from 0, which is gone.
  EXPECT_THAT(harness.Add(WallFrame(2, 0.35)), ElementsAre("drop 1 no_source_views"));
  EXPECT_TRUE(harness.drops[0].had_fast);
  EXPECT_THAT(harness.drops[0].message, HasSubstr("no baseline"));
}

constexpr int kEnough = 100;  ///< keyframes after which it must have settled

/// Keyframes of a machine that takes `fixed_ms`, and `best_ms` times the setting's cost to the power of `exponent`,
/// until the choice is settled. @return what it said last
std::string Settle(double fixed_ms, double best_ms, double exponent, double interval_s, AutoPreset* choice) {
  std::string said;
  for (int i = 0; i < kEnough && !choice->is_settled(); ++i) {
    const double ms = fixed_ms + best_ms * std::pow(choice->setting().cost, exponent);
    said = choice->Add(ms, interval_s).value_or(said);
  }
  return said;
}

TEST(AutoPreset, WaitsUntilItKnowsBothTimes) {
  AutoPreset choice;
  for (int i = 0; i < kEnough; ++i) EXPECT_FALSE(choice.Add(1, std::nullopt));
  AutoPreset early;
  for (int i = 0; i < 7; ++i) EXPECT_FALSE(early.Add(1, 0.1)) << i;
  EXPECT_TRUE(early.Add(1, 0.1));
}

TEST(AutoPreset, AFastMachineGetsTheBestAndASlowOneIsToldThatItIsTooSlow) {
  AutoPreset fast, slow;
  EXPECT_THAT(Settle(0, 20, 1, 0.1, &fast),
              HasAll("balanced, 100 % of max_image_size, at most 10 source views", "0.02 s"));
  EXPECT_TRUE(fast.keeps_up());
  EXPECT_THAT(Settle(0, 60000, 1, 0.2, &slow), HasSubstr("too long for all of them"));
  EXPECT_FALSE(slow.keeps_up());
}

TEST(AutoPreset, SettlesWhereItKeepsUpHoweverWrongTheCostsAre) {
  int between = 0;
  for (const double fixed_ms : {0.0, 1.0, 10.0, 100.0}) {
    for (double best_ms = 1; best_ms < 1e5; best_ms *= 1.7) {
      for (const double exponent : {0.5, 0.8, 1.0, 1.25, 2.0}) {
        AutoPreset choice;
        Settle(fixed_ms, best_ms, exponent, 0.2, &choice);
        ASSERT_TRUE(choice.is_settled()) << fixed_ms << " " << best_ms << " " << exponent;
        const double ms = fixed_ms + best_ms * std::pow(choice.setting().cost, exponent);
        if (choice.keeps_up()) {
          EXPECT_LE(ms, 100) << fixed_ms << " " << best_ms << " " << exponent;
        } else {
          EXPECT_EQ(choice.index(), AutoPreset::Settings().size() - 1);
        }
        between += choice.index() > 0 && choice.keeps_up() ? 1 : 0;
        for (int i = 0; i < kEnough; ++i) EXPECT_FALSE(choice.Add(ms, 0.2)) << "it has settled";
      }
    }
  }
  EXPECT_GT(between, 50);  // of 400
}

}  // namespace
}  // namespace acmp
