// Keyframes that are estimated anew, or refined again, when better source views of them have come.

#include <algorithm>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/pipeline/dense_mapper.h"
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

DenseMapperOptions Options(int lookahead, int reestimates) {
  DenseMapperOptions options = FakeOptions(10, lookahead);
  options.reestimates = reestimates;
  return options;
}

/// Three keyframes with 1.4 degrees between neighbours: poor views of each other.
void AddPoorStart(MapperHarness* harness) {
  for (int id = 0; id < 3; ++id) harness->Add(WallFrame(id, 0.1 * id));
}

/// Those whose initial estimate was made in the calls so far, but for one keyframe.
std::vector<int64_t> EstimatedAnew(const FakePatchMatch& patch_match, int64_t newest) {
  std::vector<int64_t> ids;
  for (const auto& call : patch_match.calls) {
    if (call.pass != "photometric" || call.reference == newest) continue;
    ids.push_back(call.reference);
    EXPECT_THAT(call.sources, Contains(newest));
  }
  return ids;
}

TEST(DenseMapperReestimateTest, TheKeyframesThatGainMostAreEstimatedAnewWithTheNewOne) {
  // 0 and 2 had a view at 2.9 degrees, 1 none above 1.4: it gains most. The new one is at 4.3 degrees from 2, 5.7 from
  // 1 and 7.2 from 0.
  const std::vector<std::vector<int64_t>> expected = {{}, {1}, {1, 0}, {1, 0, 2}};
  for (int reestimates = 0; reestimates <= 3; ++reestimates) {
    MapperHarness harness(Options(2, reestimates));
    AddPoorStart(&harness);
    harness.patch_match.calls.clear();
    EXPECT_THAT(harness.Add(WallFrame(3, 0.5)), ElementsAre("fast 3", "refined 1"));
    EXPECT_EQ(EstimatedAnew(harness.patch_match, 3), expected[static_cast<size_t>(reestimates)]);
    harness.Flush();
    EXPECT_THAT(harness.fast, SizeIs(4)) << "fast maps come once";
    EXPECT_THAT(harness.refined, SizeIs(4));
  }
}

TEST(DenseMapperReestimateTest, NothingIsDoneWhereTheNewKeyframeIsNoBetterView) {
  DenseMapperOptions options = Options(2, 3);
  options.source_views.max_source_views = 2;
  MapperHarness harness(options);
  for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id));
  harness.patch_match.calls.clear();
  harness.Add(WallFrame(5, 3.5 * 0.35));  // between the last two
  EXPECT_THAT(EstimatedAnew(harness.patch_match, 5), IsEmpty());
}

TEST(DenseMapperReestimateTest, AFrameThatIsRefusedChangesNothing) {
  Frame first = MakeWallFrame(0, 0);
  first.gray = GrayImage(3, 3);
  EXPECT_THAT(MapperHarness(Options(2, 1)).Add(std::make_shared<Frame>(std::move(first))),
              ElementsAre("drop 0 invalid_input"));
  MapperHarness harness(Options(2, 1));
  AddPoorStart(&harness);
  harness.Add(WallFrame(3, 0.5));
  harness.patch_match.calls.clear();
  Frame broken = MakeWallFrame(4, 0.6);
  broken.gray = GrayImage(3, 3);
  EXPECT_THAT(harness.Add(std::make_shared<Frame>(std::move(broken))), ElementsAre("drop 4 invalid_input"));
  EXPECT_THAT(harness.patch_match.calls, IsEmpty());
}

/// The depth that the first geometric pass over a keyframe read of another.
float DepthRead(const FakePatchMatch& patch_match, int64_t reader, int64_t of) {
  const auto call = CallsOf(patch_match, "geometric", reader).at(0);
  const auto place = std::find(call.sources.begin(), call.sources.end(), of) - call.sources.begin();
  return call.source_depths.at(static_cast<size_t>(place));
}

TEST(DenseMapperReestimateTest, OthersReadTheNewEstimateInsteadOfARefinedOne) {
  for (const bool anew : {false, true}) {
    MapperHarness harness(Options(3, anew ? 9 : 0));
    for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id, 0.08 * id));
    ASSERT_THAT(harness.refined, SizeIs(2));  // 0 and 1
    harness.patch_match.calls.clear();
    ASSERT_THAT(harness.Add(WallFrame(5, 0.6)), ElementsAre("fast 5", "refined 2"));
    EXPECT_THAT(CallsOf(harness.patch_match, "photometric", 1), SizeIs(anew ? 1 : 0));
    EXPECT_EQ(DepthRead(harness.patch_match, 2, 1), anew ? kFastDepth : kRefinedDepth);
  }
}

TEST(DenseMapperReestimateTest, ItsOwnRefinementStartsFromTheNewEstimate) {
  MapperHarness harness(Options(2, 3));
  AddPoorStart(&harness);
  constexpr float kAnew = 1.01f * kWallDepth;
  harness.patch_match.fast_depth = kAnew;
  harness.Add(WallFrame(3, 0.5));
  EXPECT_EQ(CallsOf(harness.patch_match, "geometric", 1).at(0).start_depth, kAnew);
  EXPECT_EQ(harness.refined.at(1)->times.kernels_ms, 4) << "two initial estimates, two geometric passes";
}

TEST(DenseMapperReestimateTest, WhereItFailsOthersReadWhatTheyReadBefore) {
  for (const int lookahead : {2, 3}) {
    MapperHarness harness(Options(lookahead, 0));
    for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id, 0.08 * id));
    harness.mapper.set_options(Options(lookahead, 9));
    harness.patch_match.before_answer = [](const FakePatchMatch::Call& call) {
      if (call.pass == "photometric" && call.reference < 5) throw ProcessingError("device lost");
    };
    harness.patch_match.calls.clear();
    const int64_t reader = 5 - lookahead;
    EXPECT_THAT(harness.Add(WallFrame(5, 0.6)), ElementsAre("fast 5", Concat("refined ", reader)));
    EXPECT_THAT(
        harness.problems,
        AllOf(Not(IsEmpty()), Each(AllOf(HasSubstr("reestimate_failed: keyframe "), HasSubstr("device lost")))));
    // What was refined with two later keyframes only is read as its fast map anyhow.
    EXPECT_EQ(DepthRead(harness.patch_match, reader, 0), lookahead == 2 ? kFastDepth : kRefinedDepth);
  }
}

TEST(DenseMapperRefineAgainTest, WhatIsHalfwayOrLeavesTheWindowWithBetterViewsIsRefinedAgain) {
  for (const bool on : {true, false}) {
    DenseMapperOptions options = RefiningAgain(5);
    options.refine_again = on;
    MapperHarness harness(options);
    AddPoorStartAndGoodViews(&harness);
    ASSERT_THAT(harness.refined, SizeIs(4));
    // Two of five keyframes back when 3 and 4 came.
    const std::vector<int64_t> halfway = on ? std::vector<int64_t>{1, 2} : std::vector<int64_t>();
    EXPECT_EQ(std::exchange(harness.refined_again, {}), halfway);
    harness.patch_match.calls.clear();
    EXPECT_THAT(harness.Add(WallFrame(5, 1.05)), ElementsAre("fast 5", "refined 4"));
    if (!on) {
      EXPECT_THAT(harness.refined_again, IsEmpty());
      continue;
    }
    EXPECT_THAT(harness.refined_again, ElementsAre(3, 0)) << "one is halfway, one leaves";
    ASSERT_THAT(CallsOf(harness.patch_match, "photometric", 0), SizeIs(1));
    EXPECT_THAT(CallsOf(harness.patch_match, "photometric", 0)[0].sources, Contains(5)) << "the newest one, too";
    EXPECT_THAT(CallsOf(harness.patch_match, "geometric", 0), SizeIs(2));
    EXPECT_EQ(harness.refined.size(), 5u) << "its own refined map came before";
    EXPECT_EQ(harness.last_times.kernels_ms, 3) << "what was done since then";
  }
}

TEST(DenseMapperRefineAgainTest, WhatHadGoodViewsIsLeftAsItIs) {
  DenseMapperOptions options = RefiningAgain(6);
  options.source_views.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id < 6; ++id) harness.Add(WallFrame(id));
  harness.refined_again.clear();
  for (int id = 6; id < 20; ++id) harness.Add(WallFrame(id));
  EXPECT_THAT(harness.refined_again, Each(testing::Lt(6))) << "the first window may gain";
}

TEST(DenseMapperRefineAgainTest, OtherWeightsOfViewsAreNoGain) {
  DenseMapperOptions options = RefiningAgain(10);
  options.reestimates = 9;
  options.source_views.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id, 0.14 * id));  // 2 degrees: weights of 0.25 to 1, later all 1
  harness.patch_match.calls.clear();
  options.source_views.best_angle_min_deg = 2;
  harness.mapper.set_options(options);
  harness.Add(WallFrame(5, 0.14 * 4.5));
  EXPECT_THAT(EstimatedAnew(harness.patch_match, 5), IsEmpty());
  harness.Flush();
  EXPECT_THAT(harness.refined_again, IsEmpty());
}

TEST(DenseMapperRefineAgainTest, WhereItFailsTheMapsStayAndItIsTold) {
  for (const char* pass : {"photometric", "geometric"}) {
    MapperHarness harness(RefiningAgain(5));
    AddPoorStartAndGoodViews(&harness);
    harness.patch_match.before_answer = [&](const FakePatchMatch::Call& call) {
      if (call.pass == pass && call.reference == 0) throw ProcessingError("device lost");
    };
    EXPECT_THAT(harness.Add(WallFrame(5, 1.05)), ElementsAre("fast 5", "refined 4"));
    EXPECT_THAT(harness.drops, IsEmpty());
    EXPECT_THAT(harness.problems, Contains(AllOf(HasSubstr("keyframe 0 could not be"), HasSubstr("device lost"))));
    // With the fast map of before it is refined all the same.
    EXPECT_EQ(std::count(harness.refined_again.begin(), harness.refined_again.end(), 0),
              std::string(pass) == "photometric" ? 1 : 0);
  }
}

}  // namespace
}  // namespace acmp
