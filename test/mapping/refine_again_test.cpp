// Keyframes that are refined again because better source views, or better maps of them, have come.

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/mapping/dense_mapper.h"
#include "dense_mapper_fakes.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

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

TEST(RefineAgainTest, NotWhereViewsWereGoodFromTheStart) {
  DenseMapperOptions options = RefiningAgain(6);
  options.source_views.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id < 6; ++id) harness.Add(WallFrame(id));
  harness.refined_again.clear();
  for (int id = 6; id < 20; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(harness.refined_again, Each(testing::Lt(6))) << "the first window may gain";
}

TEST(RefineAgainTest, AnotherNumberOfViewsIsNoGain) {
  DenseMapperOptions options = RefiningAgain(10);
  options.source_views.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id, 0.14 * id));
  options.source_views.max_source_views = 4;
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
    EXPECT_THAT(harness.problems,
                Contains(AllOf(HasSubstr("keyframe 1 could not be refined again"), HasSubstr("device lost"))));
    EXPECT_THAT(harness.refined_again, AllOf(Contains(0), Contains(2), Not(Contains(1)))) << "it stops nobody";
  }
}

}  // namespace
}  // namespace acmp
