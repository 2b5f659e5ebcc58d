#include "acmp_mapping/mapping/dense_mapper.h"

#include <algorithm>
#include <atomic>

#include "dense_mapper_fakes.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ::testing::Ge;

/// The first keyframes wait for each other, then each comes at once, and its refinement `lookahead` keyframes later.
/// With the largest lookahead that is just before it would leave the window.
TEST(DenseMapperTest, LookaheadDecidesWhenRefinementComes) {
  using Events = std::vector<std::string>;
  const std::vector<std::vector<Events>> expected = {
      // by lookahead, from the third keyframe on
      {{"fast 0", "fast 1", "fast 2", "refined 0", "refined 1", "refined 2"}, {"fast 3", "refined 3"}},
      {{"fast 0", "fast 1", "fast 2", "refined 0", "refined 1"}, {"fast 3", "refined 2"}},
      {{"fast 0", "fast 1", "fast 2", "refined 0"}, {"fast 3", "refined 1"}, {"fast 4", "refined 2"}},
      {{"fast 0", "fast 1", "fast 2"}, {"fast 3", "refined 0"}, {"fast 4", "refined 1"}}};
  for (size_t lookahead = 0; lookahead < expected.size(); ++lookahead) {
    MapperHarness harness(FakeOptions(4, static_cast<int>(lookahead)));
    EXPECT_THAT(harness.Add(WallFrame(0)), IsEmpty());
    EXPECT_THAT(harness.Add(WallFrame(1)), IsEmpty());
    for (size_t i = 0; i < expected[lookahead].size(); ++i) {
      EXPECT_EQ(harness.Add(WallFrame(static_cast<int64_t>(i) + 2)), expected[lookahead][i]) << lookahead;
    }
    if (lookahead == 2) {
      EXPECT_THAT(harness.Flush(), ElementsAre("refined 3", "refined 4"));
    }
    harness.Flush();
    EXPECT_THAT(harness.Flush(), IsEmpty());
  }
}

TEST(DenseMapperTest, InitialEstimateIsCausalAndRefinementSeesBothSides) {
  MapperHarness harness(FakeOptions(6, 2));
  for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
  const auto initial = CallsOf(harness.engine, "photometric", 5);
  ASSERT_THAT(initial, SizeIs(1));
  EXPECT_THAT(initial[0].sources, UnorderedElementsAre(0, 1, 2, 3, 4));
  // When 7 arrives the window is 2..7.
  const auto geometric = CallsOf(harness.engine, "geometric", 5);
  ASSERT_THAT(geometric, SizeIs(2));
  EXPECT_THAT(geometric[0].sources, UnorderedElementsAre(2, 3, 4, 6, 7));
  EXPECT_EQ(geometric[0].sources, geometric[1].sources);
}

TEST(DenseMapperTest, AtMostMaxSourceViewsAreUsed) {
  DenseMapperOptions options = FakeOptions(8, 1);
  options.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
  // 5, 10 and 15 degrees to the wall's middle; 10 is best, since 5 at the middle is less elsewhere.
  EXPECT_THAT(CallsOf(harness.engine, "photometric", 7)[0].sources, ElementsAre(5, 6, 4));
  EXPECT_THAT(harness.fast.back()->source_ids, ElementsAre(5, 6, 4));
}

TEST(DenseMapperTest, GeometricPassesReadTheNeighboursAsTheyAreWhenRefinementBegins) {
  MapperHarness harness(FakeOptions(8, 3));
  for (int id = 0; id <= 7; ++id) harness.Add(WallFrame(id));
  // 4 is refined when 7 comes: 0..3 are refined, with three later keyframes each, and 5..7 have their fast maps.
  const auto calls = CallsOf(harness.engine, "geometric", 4);
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
      for (const auto& call : CallsOf(harness.engine, "geometric", id)) {
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
  options.pipeline.fill.enabled = true;
  MapperHarness harness(options);
  for (int id = 0; id <= 11; ++id) harness.Add(WallFrame(id));
  const KeyframeDepth& last = *harness.refined.back();
  // What only the last keyframe sees is completed, so it has the cost of a guess.
  EXPECT_FLOAT_EQ(last.cost(kWallCamera.width - 1, 9), 2.0f);
  // What its middle sees came into view with keyframe 5 and was a guess there. Its neighbours agree on it since.
  EXPECT_FLOAT_EQ(last.cost(12, 9), 0.05f);
  EXPECT_GT(last.confidence(12, 9), 0.74f);  // more than a pixel gets that no view agrees with
}

TEST(DenseMapperTest, MapsCarryWhatBelongsToThem) {
  MapperHarness harness(FakeOptions(6, 1));
  for (int id = 0; id <= 3; ++id) harness.Add(WallFrame(id));
  ASSERT_THAT(harness.fast, SizeIs(4));
  ASSERT_THAT(harness.refined, SizeIs(3));
  const KeyframeDepth& fast = *harness.fast[2];
  EXPECT_FALSE(fast.refined);
  EXPECT_TRUE(fast.confidence.empty() && fast.normal.empty() && fast.cost.empty() && fast.points_in_camera.empty());
  for (const float depth : fast.depth) EXPECT_FLOAT_EQ(depth, kFastDepth);
  EXPECT_EQ(fast.depth.width(), kWallCamera.width);
  EXPECT_EQ(fast.times.kernels_ms, FakeEngine::kPassMs);

  const KeyframeDepth& refined = *harness.refined[2];
  EXPECT_EQ(refined.frame->id, 2);
  EXPECT_TRUE(refined.refined);
  EXPECT_EQ(refined.times.kernels_ms, 3 * FakeEngine::kPassMs);  // one photometric and two geometric passes
  for (const float depth : refined.depth) EXPECT_FLOAT_EQ(depth, kRefinedDepth);
  EXPECT_THAT(std::vector<size_t>({refined.confidence.size(), refined.normal.size(), refined.cost.size()}),
              Each(refined.depth.size()));
  EXPECT_EQ(refined.normal(12, 9).z, -1);
  ASSERT_FALSE(refined.points_in_camera.empty());
  for (const SurfacePoint& point : refined.points_in_camera) {
    // Averaged with a source that has only its fast map, 0.2 % off.
    EXPECT_NEAR(point.position.z, kWallDepth, 0.002 * kWallDepth);
  }
  EXPECT_GT(refined.confidence(12, 9), 0);  // the image's middle is seen by every neighbour
}

/// A pass at full size takes minutes on a CPU, and Ctrl-C, an unload or a reset waits for it.
TEST(DenseMapperTest, AStopEndsThePassUnderWay) {
  MapperHarness harness(FakeOptions(6, 2));
  for (int64_t id = 0; id < 3; ++id) harness.Add(WallFrame(id));
  std::atomic<int> rows = {0};
  harness.engine.before_answer = [&](const WallEngine::Call&) {
    tbb::parallel_for(0, 1000, [&](int) {
      if (++rows == 1) harness.stop.Request();
    });
  };
  EXPECT_THAT(harness.Add(WallFrame(3)), IsEmpty()) << "what the pass has left is no map";
  EXPECT_LT(rows, 1000);
  EXPECT_THAT(harness.Add(WallFrame(4)), ElementsAre("drop 4 reset"));
  EXPECT_THAT(harness.Flush(), IsEmpty());
  EXPECT_THAT(harness.Reset(), ElementsAre("drop 1 reset", "drop 2 reset", "drop 3 reset"));
  harness.stop.Clear();
  harness.engine.before_answer = nullptr;
  for (int64_t id = 0; id < 2; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(harness.Add(WallFrame(2)), ElementsAre("fast 0", "fast 1", "fast 2", "refined 0"));
}

TEST(DenseMapperOptionsTest, AreCheckedAndKeptWhenBad) {
  EXPECT_NO_THROW(Validate(DenseMapperOptions{}));
  const auto error_with = [](auto set) {
    DenseMapperOptions options;
    set(options);
    return ErrorOf([&] { Validate(options); });
  };
  EXPECT_THAT(error_with([](auto& o) { o.pipeline = MakePreset("acmm"); }), HasSubstr("offline"));
  EXPECT_THAT(error_with([](auto& o) { o.window_size = 1; }), HasSubstr("window_size = 1"));
  EXPECT_THAT(error_with([](auto& o) { o.lookahead = 30; }), HasSubstr("lookahead = 30"));
  EXPECT_THAT(error_with([](auto& o) { o.min_source_views = 11; }), HasSubstr("min_source_views = 11"));
  EXPECT_EQ(error_with([](auto& o) { o.fallback_depth_range = {0, 1}; }), "no error") << "the other end is to come";

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
  EXPECT_THAT(CallsOf(harness.engine, "geometric", 3), SizeIs(1));
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
    const auto calls = CallsOf(harness.engine, "photometric", id);
    ASSERT_THAT(calls, SizeIs(1)) << id;
    EXPECT_EQ(calls[0].width, expected[static_cast<size_t>(id)]) << id;
    for (const auto& call : CallsOf(harness.engine, "geometric", id)) EXPECT_EQ(call.width, 24) << id;
  }
  for (const auto& depth : harness.fast) {
    ASSERT_EQ(depth->depth.width(), kWallCamera.width);
    ASSERT_EQ(depth->depth.height(), kWallCamera.height);
    for (const float z : depth->depth) EXPECT_FLOAT_EQ(z, kFastDepth);
  }
}

// Keyframes that are refined again because better source views, or better maps of them, have come.

TEST(RefineAgainTest, HalfwayThroughTheWindowWhereViewsHaveBecomeBetter) {
  for (const bool on : {true, false}) {
    DenseMapperOptions options = RefiningAgain(5);
    options.refine_again = on;
    MapperHarness harness(options);
    AddPoorStartAndGoodViews(&harness);
    ASSERT_THAT(harness.refined, SizeIs(4));
    // Two of five keyframes back when 3 and 4 came.
    EXPECT_EQ(harness.refined_again, on ? std::vector<int64_t>({1, 2}) : std::vector<int64_t>());
    const auto initial = CallsOf(harness.engine, "photometric", 1);
    ASSERT_THAT(initial, SizeIs(on ? 2 : 1));
    if (!on) continue;
    EXPECT_THAT(initial[1].sources, Contains(3)) << "a new initial estimate with the newest view";
    EXPECT_EQ(harness.last_times.kernels_ms, 3 * FakeEngine::kPassMs) << "what was done since then";
    harness.refined_again.clear();
    EXPECT_THAT(harness.Add(WallFrame(5, 1.05)), ElementsAre("fast 5", "refined 4"));
    EXPECT_THAT(harness.refined_again, IsEmpty()) << "only the maps of its source views have become better";
  }
}

TEST(RefineAgainTest, LiveWhereThereIsTimeTheNewestFirst) {
  DenseMapperOptions options = RefiningAgain(5);
  options.live = true;
  MapperHarness harness(options);
  AddPoorStartAndGoodViews(&harness);
  EXPECT_THAT(harness.refined_again, IsEmpty());
  size_t before = 0;
  while (harness.mapper.CatchUp()) {
    EXPECT_LE(harness.refined_again.size(), before + 1) << "one thing at a time";
    before = harness.refined_again.size();
  }
  EXPECT_THAT(harness.refined_again, ElementsAre(2, 1));
  EXPECT_EQ(harness.mapper.left_out().second_turns, 0u);
  EXPECT_THAT(harness.drops, IsEmpty());
}

TEST(RefineAgainTest, LiveThoseWithoutTimeAreCounted) {
  DenseMapperOptions options = RefiningAgain(5);
  options.live = true;
  MapperHarness harness(options);
  for (int id = 0; id < 12; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(harness.refined_again, IsEmpty());
  EXPECT_EQ(harness.mapper.left_out().second_turns, 12u - 5u);
  EXPECT_THAT(harness.refined, SizeIs(12 - options.lookahead)) << "they have their first refined maps";
}

TEST(RefineAgainTest, NotWhereViewsWereGoodFromTheStart) {
  DenseMapperOptions options = RefiningAgain(6);
  options.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id < 6; ++id) harness.Add(WallFrame(id));
  harness.refined_again.clear();
  for (int id = 6; id < 20; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(harness.refined_again, Each(testing::Lt(6))) << "the first window may gain";
}

TEST(RefineAgainTest, NotWhereViewsHaveBecomeWorse) {
  DenseMapperOptions options = FakeOptions(4, 0, 1);
  options.refine_again = true;
  MapperHarness harness(options);
  // 3 has good views on both sides, which leave the window; 5 has a good one when 6 comes.
  const std::vector<double> places = {-0.4, 0.4, 0, 0.03, 0.06, 0.09, 0.5};
  for (size_t id = 0; id < places.size(); ++id) harness.Add(WallFrame(static_cast<int64_t>(id), places[id]));
  harness.refined_again.clear();
  harness.Flush();
  EXPECT_THAT(harness.refined_again, AllOf(Contains(5), Not(Contains(3))));
}

TEST(RefineAgainTest, AnotherNumberOfViewsIsNoGain) {
  DenseMapperOptions options = RefiningAgain(10);
  options.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id, 0.14 * id));
  options.max_source_views = 4;
  harness.mapper.set_options(options);
  harness.Flush();
  EXPECT_THAT(harness.refined_again, IsEmpty());
}

TEST(RefineAgainTest, AFlushTakesAllKeyframesWithBetterViewsAndThoseWithBetterMaps) {
  MapperHarness harness(RefiningAgain(10));
  AddPoorStartAndGoodViews(&harness);
  harness.TakeEvents();
  harness.refined_again.clear();
  EXPECT_THAT(harness.Flush(), ElementsAre("refined 4")) << "what is pending is finished";
  EXPECT_THAT(harness.refined_again, AllOf(Contains(0), Contains(1), Contains(2), Contains(3)));
  harness.refined_again.clear();
  harness.Flush();
  EXPECT_THAT(harness.refined_again, IsEmpty()) << "nothing more has come";
}

TEST(RefineAgainTest, AtAFlushKeyframesTakeTheirStepsSideBySide) {
  MapperHarness harness(RefiningAgain(10));
  AddPoorStartAndGoodViews(&harness);
  harness.Add(WallFrame(5, 1.05));
  DenseMapperOptions options = RefiningAgain(10);
  options.refine_again = false;
  harness.mapper.set_options(options);
  harness.Flush();
  options.refine_again = true;
  harness.mapper.set_options(options);
  harness.engine.calls.clear();
  harness.Flush();
  std::vector<int> passes;
  for (const WallEngine::Call& call : harness.engine.calls) {
    if (call.pass != "geometric") continue;
    passes.push_back(call.geometric_pass);
    EXPECT_THAT(call.source_depths, Each(call.geometric_pass == 0 ? kFastDepth : kRefinedDepth))
        << "all were refined before, but what is read is what the step before has made";
  }
  EXPECT_THAT(passes, SizeIs(testing::Gt(2)));
  EXPECT_TRUE(std::is_sorted(passes.begin(), passes.end())) << "no keyframe takes a step before all have the last one";
}

TEST(RefineAgainTest, WhereItFailsTheMapsStayAndItIsTold) {
  for (const char* pass : {"photometric", "geometric"}) {
    MapperHarness harness(RefiningAgain(10));
    AddPoorStartAndGoodViews(&harness);
    harness.refined_again.clear();
    harness.engine.before_answer = [&](const WallEngine::Call& call) {
      if (call.pass == pass && call.reference == 1) throw ProcessingError("device lost");
    };
    EXPECT_THAT(harness.Flush(), ElementsAre("refined 4"));
    EXPECT_THAT(harness.drops, IsEmpty());
    EXPECT_THAT(harness.problems, Contains(HasAll("keyframe 1 could not be refined again", "device lost")));
    EXPECT_THAT(harness.refined_again, AllOf(Contains(0), Contains(2), Not(Contains(1)))) << "it stops nobody";
  }
}

}  // namespace
}  // namespace acmp
