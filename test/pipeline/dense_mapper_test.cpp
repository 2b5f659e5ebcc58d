#include "acmp_mapping/pipeline/dense_mapper.h"

#include <limits>
#include <new>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "dense_mapper_fakes.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::Ge;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::UnorderedElementsAre;
using Strings = std::vector<std::string>;

constexpr float kFastDepth = static_cast<float>(kWallDepth * FakePatchMatch::kFastError);
constexpr float kRefinedDepth = static_cast<float>(kWallDepth);

std::vector<FakePatchMatch::Call> CallsOf(const FakePatchMatch& patch_match, const std::string& pass, int64_t id) {
  std::vector<FakePatchMatch::Call> calls;
  for (const auto& call : patch_match.calls) {
    if (call.pass == pass && call.reference == id) calls.push_back(call);
  }
  return calls;
}

TEST(DenseMapperTest, FirstKeyframesWaitThenEachComesAtOnce) {
  MapperHarness harness(FakeOptions(6, 2));
  EXPECT_THAT(harness.Add(WallFrame(0)), IsEmpty());
  EXPECT_THAT(harness.Add(WallFrame(1)), IsEmpty());
  EXPECT_EQ(harness.mapper.unfinished(), 2u);
  EXPECT_THAT(harness.Add(WallFrame(2)), ElementsAre("fast 0", "fast 1", "fast 2", "refined 0"));
  EXPECT_THAT(harness.Add(WallFrame(3)), ElementsAre("fast 3", "refined 1"));
  EXPECT_THAT(harness.Add(WallFrame(4)), ElementsAre("fast 4", "refined 2"));
  EXPECT_EQ(harness.mapper.unfinished(), 2u);
  EXPECT_THAT(harness.Flush(), ElementsAre("refined 3", "refined 4"));
  EXPECT_EQ(harness.mapper.unfinished(), 0u);
  EXPECT_THAT(harness.Flush(), IsEmpty());
}

TEST(DenseMapperTest, LookaheadDecidesWhenRefinementComes) {
  MapperHarness causal(FakeOptions(4, 0));
  causal.Add(WallFrame(0));
  causal.Add(WallFrame(1));
  EXPECT_THAT(causal.Add(WallFrame(2)),
              ElementsAre("fast 0", "fast 1", "fast 2", "refined 0", "refined 1", "refined 2"));
  EXPECT_THAT(causal.Add(WallFrame(3)), ElementsAre("fast 3", "refined 3"));

  MapperHarness one(FakeOptions(4, 1));
  one.Add(WallFrame(0));
  one.Add(WallFrame(1));
  EXPECT_THAT(one.Add(WallFrame(2)), ElementsAre("fast 0", "fast 1", "fast 2", "refined 0", "refined 1"));
  EXPECT_THAT(one.Add(WallFrame(3)), ElementsAre("fast 3", "refined 2"));

  // The largest lookahead: a keyframe is refined just before it would leave the window.
  MapperHarness three(FakeOptions(4, 3));
  for (int id = 0; id < 3; ++id) three.Add(WallFrame(id));
  EXPECT_THAT(three.Add(WallFrame(3)), ElementsAre("fast 3", "refined 0"));
  EXPECT_THAT(three.Add(WallFrame(4)), ElementsAre("fast 4", "refined 1"));
}

TEST(DenseMapperTest, SmallestWindowPairsNeighbours) {
  MapperHarness harness(FakeOptions(2, 1, 1));
  EXPECT_THAT(harness.Add(WallFrame(0)), IsEmpty());
  EXPECT_THAT(harness.Add(WallFrame(1)), ElementsAre("fast 0", "fast 1", "refined 0"));
  EXPECT_THAT(harness.Add(WallFrame(2)), ElementsAre("fast 2", "refined 1"));
  for (const auto& call : harness.patch_match.calls) EXPECT_THAT(call.sources, SizeIs(1));
}

TEST(DenseMapperTest, InitialEstimateIsCausalAndRefinementSeesBothSides) {
  MapperHarness harness(FakeOptions(6, 2));
  for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
  const auto initial = CallsOf(harness.patch_match, "photometric", 5);
  ASSERT_THAT(initial, SizeIs(1));
  EXPECT_THAT(initial[0].sources, UnorderedElementsAre(0, 1, 2, 3, 4));
  // When 7 arrives the window is 2..7.
  const auto geometric = CallsOf(harness.patch_match, "geometric", 5);
  ASSERT_THAT(geometric, SizeIs(2));
  EXPECT_THAT(geometric[0].sources, UnorderedElementsAre(2, 3, 4, 6, 7));
  EXPECT_EQ(geometric[0].sources, geometric[1].sources);
}

TEST(DenseMapperTest, AtMostMaxSourceViewsAreUsed) {
  DenseMapperOptions options = FakeOptions(8, 1);
  options.source_views.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
  // 5, 10 and 15 degrees to the wall's middle; 10 is best, since 5 at the middle is less elsewhere.
  EXPECT_THAT(CallsOf(harness.patch_match, "photometric", 7)[0].sources, ElementsAre(5, 6, 4));
  EXPECT_THAT(harness.fast.back()->source_ids, ElementsAre(5, 6, 4));
}

TEST(DenseMapperTest, GeometricPassesReadTheNeighboursAsTheyAreWhenRefinementBegins) {
  MapperHarness harness(FakeOptions(8, 3));
  for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
  // 4 is refined when 7 comes: 0..3 are refined, with three later keyframes each, and 5..7 have their fast maps.
  const auto calls = CallsOf(harness.patch_match, "geometric", 4);
  ASSERT_THAT(calls, SizeIs(2));
  for (size_t pass = 0; pass < calls.size(); ++pass) {
    EXPECT_EQ(calls[pass].geometric_pass, static_cast<int>(pass));
    ASSERT_EQ(calls[pass].sources.size(), 7u);
    for (size_t j = 0; j < calls[pass].sources.size(); ++j) {
      EXPECT_FLOAT_EQ(calls[pass].source_depths[j], calls[pass].sources[j] > 4 ? kFastDepth : kRefinedDepth);
    }
  }
  EXPECT_FLOAT_EQ(calls[0].start_depth, kFastDepth);
  EXPECT_FLOAT_EQ(calls[1].start_depth, kRefinedDepth);
}

TEST(DenseMapperTest, GeometricPassesDoNotReadWhatWasRefinedWithFewLaterKeyframes) {
  for (const int lookahead : {0, 2}) {
    MapperHarness harness(FakeOptions(8, lookahead));
    for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
    for (int id = 0; id <= 7 - lookahead; ++id) {
      for (const auto& call : CallsOf(harness.patch_match, "geometric", id)) {
        EXPECT_THAT(call.source_depths, Each(kFastDepth)) << lookahead;
      }
    }
  }
}

TEST(DenseMapperTest, TheConsistencyCheckReadsRefinedNeighboursAtOnce) {
  MapperHarness harness(FakeOptions(8, 0));
  for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
  ASSERT_FALSE(harness.refined.back()->points_in_camera.empty());
  for (const SurfacePoint& point : harness.refined.back()->points_in_camera) {
    // A point is the mean over the views that agree: one fast among eight would put it 0.02 % off or more. Rounding to
    // float is below 1e-6 of the depth for the few steps there are.
    EXPECT_NEAR(point.position.z, kWallDepth, 1e-5 * kWallDepth);
  }
}

TEST(DenseMapperTest, CompletedPixelsDoNotSpreadFromKeyframeToKeyframe) {
  DenseMapperOptions options = FakeOptions(8, 0);
  options.pipeline.completion.enabled = true;
  MapperHarness harness(options);
  for (int id = 0; id <= 11; ++id) harness.Add(WallFrame(id));
  const KeyframeDepth& last = *harness.refined.back();
  // What only the last keyframe sees is completed, so it has the cost of a guess.
  EXPECT_FLOAT_EQ(last.cost(kWallCamera.width - 1, 9), 2.0f);
  // What its middle sees came into view with keyframe 5 and was a guess there. Its neighbours agree on it since.
  EXPECT_FLOAT_EQ(last.cost(12, 9), 0.05f);
  EXPECT_GT(last.confidence(12, 9), 0.2f);  // the most that a pixel without a consistent view gets
}

TEST(DenseMapperTest, MapsCarryWhatBelongsToThem) {
  MapperHarness harness(FakeOptions(6, 1));
  for (int id = 0; id <= 3; ++id) harness.Add(WallFrame(id));
  ASSERT_THAT(harness.fast, SizeIs(4));
  ASSERT_THAT(harness.refined, SizeIs(3));
  const KeyframeDepth& fast = *harness.fast[2];
  EXPECT_FALSE(fast.refined);
  EXPECT_TRUE(fast.confidence.empty());
  EXPECT_THAT(fast.points_in_camera, IsEmpty());
  EXPECT_EQ(fast.depth.width(), kWallCamera.width);
  EXPECT_EQ(fast.cost.height(), kWallCamera.height);
  for (const float depth : fast.depth) EXPECT_FLOAT_EQ(depth, kFastDepth);
  for (const Vec3f& normal : fast.normal) EXPECT_EQ(normal.z, -1);
  EXPECT_EQ(fast.times.kernels_ms, 1);

  const KeyframeDepth& refined = *harness.refined[2];
  EXPECT_EQ(refined.frame->id, 2);
  EXPECT_TRUE(refined.refined);
  EXPECT_EQ(refined.times.kernels_ms, 3);  // one photometric and two geometric passes
  for (const float depth : refined.depth) EXPECT_FLOAT_EQ(depth, kRefinedDepth);
  ASSERT_EQ(refined.confidence.size(), refined.depth.size());
  ASSERT_FALSE(refined.points_in_camera.empty());
  for (const SurfacePoint& point : refined.points_in_camera) {
    // Averaged with a source that has only its fast map, 0.2 % off.
    EXPECT_NEAR(point.position.z, kWallDepth, 0.002 * kWallDepth);
  }
  // The image's middle is seen by every neighbour.
  EXPECT_GT(refined.confidence(12, 9), 0);
}

TEST(DenseMapperTest, WithoutGeometricPassesRefinementOnlyChecksConsistency) {
  DenseMapperOptions options = FakeOptions(6, 1);
  options.pipeline.geometric_passes = 0;
  MapperHarness harness(options);
  for (int id = 0; id <= 3; ++id) harness.Add(WallFrame(id));
  for (const auto& call : harness.patch_match.calls) EXPECT_EQ(call.pass, "photometric");
  ASSERT_THAT(harness.refined, SizeIs(3));
  for (const float depth : harness.refined[1]->depth) EXPECT_FLOAT_EQ(depth, kFastDepth);
  EXPECT_FALSE(harness.refined[1]->points_in_camera.empty());
}

TEST(DenseMapperTest, UsesThePriorWhenAskedTo) {
  DenseMapperOptions options = FakeOptions(6, 1);
  options.pipeline = MakePreset("acmp");
  MapperHarness harness(options);
  for (int id = 0; id <= 2; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(CallsOf(harness.patch_match, "prior", 1), SizeIs(1));
}

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
  EXPECT_THAT(harness.drops[0].message, AllOf(HasSubstr("keyframe 3"), HasSubstr("no other keyframe")));
  EXPECT_FALSE(harness.drops[0].had_fast);
  // It still serves as a source view of later ones.
  harness.Add(WallFrame(4));
  EXPECT_THAT(harness.Add(WallFrame(5)), ElementsAre("fast 4", "fast 5"));
}

TEST(DenseMapperResetTest, AccountsForEverythingAndForgetsIt) {
  MapperHarness harness(FakeOptions(6, 2));
  for (int id = 10; id <= 13; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(harness.Reset(), ElementsAre("drop 12 reset", "drop 13 reset"));
  EXPECT_TRUE(harness.drops[0].had_fast);
  EXPECT_THAT(harness.drops[0].message, HasSubstr("keyframe 12"));
  EXPECT_EQ(harness.mapper.unfinished(), 0u);
  EXPECT_THAT(harness.Reset(), IsEmpty());
  // Ids may start again, e.g. when a bag loops; the depth range is forgotten.
  EXPECT_THAT(harness.Add(WallFrame(1, 0.35, {})), ElementsAre("drop 1 no_depth_range"));
}

TEST(DenseMapperIdTest, MustAscend) {
  MapperHarness harness(FakeOptions(6, 2));
  harness.Add(WallFrame(5));
  for (const int64_t id : {5, 4, -1}) {
    try {
      harness.mapper.AddKeyframe(WallFrame(id));
      FAIL() << id;
    } catch (const InvalidInputError& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr(Concat("id = ", id)), HasSubstr("5")));
    }
  }
  EXPECT_THROW(harness.mapper.AddKeyframe(nullptr), InvalidInputError);
  EXPECT_EQ(harness.mapper.unfinished(), 1u);
  harness.Add(WallFrame(100));
  EXPECT_THAT(harness.Add(WallFrame(101)), Each(HasSubstr("fast")));
}

TEST(DenseMapperIdenticalPosesTest, DropsWithTheReasonWhenTheyLeaveTheWindow) {
  MapperHarness harness(FakeOptions(3, 1));
  for (int id = 0; id < 3; ++id) EXPECT_THAT(harness.Add(WallFrame(id, 1.0)), IsEmpty());
  EXPECT_THAT(harness.Add(WallFrame(3, 1.0)), ElementsAre("drop 0 no_source_views"));
  EXPECT_THAT(harness.drops[0].message,
              AllOf(HasSubstr("keyframe 0"), HasSubstr("0 of 2"), HasSubstr("2 with no baseline")));
  EXPECT_THAT(harness.Flush(),
              ElementsAre("drop 1 no_source_views", "drop 2 no_source_views", "drop 3 no_source_views"));
  EXPECT_THAT(harness.patch_match.calls, IsEmpty());
}

TEST(DenseMapperIdenticalPosesTest, GoesOnOnceTheCameraMoves) {
  MapperHarness harness(FakeOptions(5, 1));
  for (int id = 0; id < 3; ++id) harness.Add(WallFrame(id, 1.0));
  EXPECT_THAT(harness.Add(WallFrame(3, 1.4)), ElementsAre("fast 3"));
  EXPECT_THAT(harness.Add(WallFrame(4, 1.8)),
              ElementsAre("fast 0", "fast 1", "fast 2", "fast 4", "refined 0", "refined 1", "refined 2", "refined 3"));
  // Views at the same place never count as sources.
  EXPECT_THAT(CallsOf(harness.patch_match, "photometric", 0)[0].sources, UnorderedElementsAre(3, 4));
}

TEST(DenseMapperIdenticalPosesTest, NamesTheAngleThatIsTooSmall) {
  MapperHarness harness(FakeOptions(3, 1));
  for (int id = 0; id < 3; ++id) harness.Add(WallFrame(id, 0.01 * id));  // 0.14 degrees at the wall's middle
  EXPECT_THAT(harness.Flush(), SizeIs(3));
  EXPECT_THAT(harness.drops[1].message,
              AllOf(HasSubstr("2 below"), HasSubstr("1 degree"), HasSubstr("largest found: 0.1")));
}

TEST(DenseMapperDepthRangeTest, ComesFromTheLandmarksInView) {
  const DenseMapperOptions options = FakeOptions(6, 2);
  MapperHarness harness(options);
  std::vector<Eigen::Vector3d> whole_map = WallLandmarks();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 5000; ++i) {
    whole_map.insert(whole_map.end(), {{nan, nan, nan}, {0, 0, 0}, {0.3, 0, -1.0 - i}, {1000.0 + i, 0, 2}});
  }
  for (int id = 0; id < 3; ++id) harness.Add(WallFrame(id, 0.35 * id, whole_map));
  ASSERT_THAT(harness.fast, SizeIs(3));
  for (const auto& depth : harness.fast) {
    EXPECT_FLOAT_EQ(depth->range.min, static_cast<float>(kWallDepth / options.depth_range.margin));
    EXPECT_FLOAT_EQ(depth->range.max, static_cast<float>(kWallDepth * options.depth_range.margin));
  }
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
  const auto from_landmarks = static_cast<float>(kWallDepth * options.depth_range.margin);
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
                AllOf(HasSubstr(Concat("keyframe ", i)), HasSubstr(Concat(clouds[i].size(), " landmarks")),
                      HasSubstr("no fallback")));
  }
  // They are source views all the same: the first keyframe with landmarks needs no further ones.
  EXPECT_THAT(harness.Add(WallFrame(5)), ElementsAre("fast 5"));
  EXPECT_THAT(harness.Add(WallFrame(6, 2.1, {})), ElementsAre("fast 6"));
}

TEST(DenseMapperFailureTest, OfAnEstimateDropsThatKeyframeOnly) {
  const auto run = [](const std::function<void()>& fail) {
    MapperHarness harness(FakeOptions(6, 1));
    harness.patch_match.before_answer = [&](const FakePatchMatch::Call& call) {
      if (call.reference == 3) fail();
    };
    Strings events;
    for (int id = 0; id <= 5; ++id) {
      for (const std::string& event : harness.Add(WallFrame(id))) events.push_back(event);
    }
    EXPECT_THAT(harness.drops, SizeIs(1));
    EXPECT_FALSE(harness.drops[0].had_fast);
    EXPECT_EQ(harness.mapper.unfinished(), 1u);
    EXPECT_THAT(CallsOf(harness.patch_match, "photometric", 5)[0].sources, testing::Contains(3));
    return std::make_pair(events, harness.drops[0].message);
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
  harness.patch_match.before_answer = [](const FakePatchMatch::Call& call) {
    if (call.reference == 2 && call.pass == "geometric") throw ProcessingError("device lost");
  };
  for (int id = 0; id <= 6; ++id) harness.Add(WallFrame(id));
  ASSERT_THAT(harness.drops, SizeIs(1));
  EXPECT_EQ(harness.drops[0].id, 2);
  EXPECT_TRUE(harness.drops[0].had_fast);
  const auto call = CallsOf(harness.patch_match, "geometric", 3)[0];
  for (size_t j = 0; j < call.sources.size(); ++j) {
    EXPECT_FLOAT_EQ(call.source_depths[j], call.sources[j] <= 1 ? kRefinedDepth : kFastDepth);
  }
}

TEST(DenseMapperFailureTest, BadFramesAreRefusedAndNeverBecomeSources) {
  MapperHarness harness(FakeOptions(10, 1));
  harness.Add(WallFrame(0));
  Frame bad_pose = MakeWallFrame(1, 0.35);
  bad_pose.cam_from_world.translation().y() = std::nan("");
  EXPECT_THAT(harness.Add(std::make_shared<Frame>(std::move(bad_pose))), ElementsAre("drop 1 invalid_input"));
  EXPECT_THAT(harness.drops.back().message, HasSubstr("keyframe 1"));
  Frame bad_size = MakeWallFrame(2, 0.7);
  bad_size.gray = GrayImage(23, 18);
  EXPECT_THAT(harness.Add(std::make_shared<Frame>(std::move(bad_size))), ElementsAre("drop 2 invalid_input"));
  EXPECT_THAT(harness.drops.back().message, AllOf(HasSubstr("23 x 18"), HasSubstr("24 x 18")));
  Frame bad_color = MakeWallFrame(3, 0.7);
  bad_color.color = ColorImage(1, 1);
  EXPECT_THAT(harness.Add(std::make_shared<Frame>(std::move(bad_color))), ElementsAre("drop 3 invalid_input"));
  Frame bad_camera = MakeWallFrame(4, 0.7);
  bad_camera.camera.fx = 0;
  EXPECT_THAT(harness.Add(std::make_shared<Frame>(std::move(bad_camera))), ElementsAre("drop 4 invalid_input"));
  harness.Add(WallFrame(5, 0.5));
  EXPECT_THAT(harness.Add(WallFrame(6, 1.0)), testing::Contains("fast 6"));
  EXPECT_THAT(CallsOf(harness.patch_match, "photometric", 6)[0].sources, UnorderedElementsAre(0, 5));
}

TEST(DenseMapperEvictionTest, KeepsNothingButTheWindow) {
  MapperHarness harness(FakeOptions(4, 2));
  harness.keep_maps = false;
  std::vector<std::weak_ptr<const Frame>> frames;
  for (int id = 0; id < 30; ++id) {
    FramePtr frame = WallFrame(id);
    frames.push_back(frame);
    harness.Add(std::move(frame));
    for (int old = 0; old < id - 3; ++old) EXPECT_TRUE(frames[old].expired()) << old << " at " << id;
  }
  harness.Reset();
  for (const auto& frame : frames) EXPECT_TRUE(frame.expired());
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

TEST(DenseMapperOptionsTest, AreCheckedAndKeptWhenBad) {
  EXPECT_NO_THROW(Validate(DenseMapperOptions{}));
  const auto error_with = [](auto set) -> std::string {
    DenseMapperOptions options;
    set(options);
    try {
      Validate(options);
    } catch (const InvalidInputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(error_with([](auto& o) { o.window_size = 1; }), HasSubstr("window_size = 1"));
  EXPECT_THAT(error_with([](auto& o) { o.window_size = 65; }), HasSubstr("window_size = 65"));
  EXPECT_THAT(error_with([](auto& o) { o.lookahead = 10; }), HasSubstr("lookahead = 10"));
  EXPECT_THAT(error_with([](auto& o) { o.lookahead = -1; }), HasSubstr("lookahead = -1"));
  EXPECT_THAT(error_with([](auto& o) { o.min_source_views = 0; }), HasSubstr("min_source_views = 0"));
  EXPECT_THAT(error_with([](auto& o) { o.min_source_views = 8; }), HasSubstr("min_source_views = 8"));
  EXPECT_THAT(error_with([](auto& o) { o.window_size = 2, o.lookahead = 1; }), HasSubstr("min_source_views = 2"));
  EXPECT_THAT(error_with([](auto& o) { o.fallback_depth_range = {2, 1}; }), HasSubstr("fallback_depth_range"));
  EXPECT_THAT(error_with([](auto& o) { o.fallback_depth_range = {0, 1}; }), HasSubstr("fallback_depth_range"));
  EXPECT_THAT(error_with([](auto& o) { o.source_views.max_source_views = 0; }), HasSubstr("max_source_views"));
  EXPECT_THAT(error_with([](auto& o) { o.depth_range.margin = 0; }), HasSubstr("margin"));
  EXPECT_THAT(error_with([](auto& o) { o.pipeline.geometric_passes = 11; }), HasSubstr("geometric_passes"));

  MapperHarness harness(FakeOptions(6, 0));
  DenseMapperOptions bad = FakeOptions(6, 2);
  bad.window_size = 0;
  EXPECT_THROW(harness.mapper.set_options(bad), InvalidInputError);
  harness.Add(WallFrame(0));
  harness.Add(WallFrame(1));
  EXPECT_THAT(harness.Add(WallFrame(2)), SizeIs(6));  // still lookahead 0
  EXPECT_THROW(DenseMapper(&harness.engine, bad, {}), InvalidInputError);
  EXPECT_THROW(DenseMapper(nullptr, FakeOptions(6, 2), {}), InvalidInputError);
}

TEST(DenseMapperOptionsTest, TakeEffectFromTheNextKeyframe) {
  MapperHarness harness(FakeOptions(6, 2));
  for (int id = 0; id < 4; ++id) harness.Add(WallFrame(id));
  DenseMapperOptions options = FakeOptions(6, 1);
  options.pipeline.geometric_passes = 1;
  harness.mapper.set_options(options);
  EXPECT_THAT(harness.TakeEvents(), IsEmpty());
  EXPECT_THAT(harness.Add(WallFrame(4)), ElementsAre("fast 4", "refined 2", "refined 3"));
  EXPECT_THAT(CallsOf(harness.patch_match, "geometric", 3), SizeIs(1));
}

TEST(DenseMapperOptionsTest, StartLevelHalvesThePhotometricPassAndNothingElse) {
  MapperHarness harness(FakeOptions(6, 2));
  for (int id = 0; id < 4; ++id) harness.Add(WallFrame(id));
  DenseMapperOptions options = FakeOptions(6, 2);
  // The sources are in the window already, loaded without halved images.
  options.pipeline.start_level = 1;
  harness.mapper.set_options(options);
  EXPECT_THAT(harness.Add(WallFrame(4)), ElementsAre("fast 4", "refined 2"));
  // And again for a level above the one they were loaded with.
  options.pipeline.start_level = 2;
  harness.mapper.set_options(options);
  EXPECT_THAT(harness.Add(WallFrame(5)), ElementsAre("fast 5", "refined 3"));
  options.pipeline.start_level = 0;
  harness.mapper.set_options(options);
  EXPECT_THAT(harness.Add(WallFrame(6)), ElementsAre("fast 6", "refined 4"));
  const std::vector<int> expected = {24, 24, 24, 24, 12, 6, 24};
  for (int id = 0; id <= 6; ++id) {
    const auto calls = CallsOf(harness.patch_match, "photometric", id);
    ASSERT_THAT(calls, SizeIs(1)) << id;
    EXPECT_EQ(calls[0].width, expected[static_cast<size_t>(id)]) << id;
    for (const auto& call : CallsOf(harness.patch_match, "geometric", id)) EXPECT_EQ(call.width, 24) << id;
  }
  for (const auto& depth : harness.fast) {
    ASSERT_EQ(depth->depth.width(), kWallCamera.width);
    ASSERT_EQ(depth->cost.height(), kWallCamera.height);
    for (const float z : depth->depth) EXPECT_FLOAT_EQ(z, kFastDepth);
  }
}

TEST(DenseMapperTest, CallbacksMayBeEmpty) {
  FakePatchMatch patch_match;
  HostDepthEngine engine(&patch_match);
  DenseMapper mapper(&engine, FakeOptions(3, 1), {});
  for (int id = 0; id < 6; ++id) mapper.AddKeyframe(WallFrame(id));
  mapper.AddKeyframe(WallFrame(6, -100));
  mapper.Flush();
  EXPECT_THAT(patch_match.calls, SizeIs(Ge(6)));
}

}  // namespace
}  // namespace acmp
