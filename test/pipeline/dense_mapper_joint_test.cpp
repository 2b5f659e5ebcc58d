// Keyframes of the window that a flush refines again together.

#include <algorithm>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
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

TEST(DenseMapperFlushAgainTest, LeavesOutWhatNobodyWants) {
  for (const bool refine_again : {true, false}) {
    MapperHarness harness(RefiningAgain(10));
    AddPoorStartAndGoodViews(&harness);
    harness.unwanted = {0, 2};
    harness.TakeEvents();
    harness.mapper.Flush(refine_again);
    EXPECT_THAT(harness.TakeEvents(), ElementsAre("refined 4")) << "what is pending is finished";
    if (refine_again) {
      EXPECT_THAT(harness.refined_again, AllOf(Contains(1), Not(Contains(0)), Not(Contains(2))));
    } else {
      EXPECT_THAT(harness.refined_again, IsEmpty());
    }
  }
}

/// Ready for a flush in which all five gain or read what gains; 4 is still to be refined for the first time.
void AddFive(MapperHarness* harness) {
  AddPoorStartAndGoodViews(harness);
  harness->refined_again.clear();
  harness->patch_match.calls.clear();
}

TEST(DenseMapperFlushAgainTest, AllTakeTheirStepsTogetherAndThenOnceMoreOneByOne) {
  MapperHarness harness(RefiningAgain(10));
  AddFive(&harness);
  EXPECT_THAT(harness.Flush(), ElementsAre("refined 4"));
  EXPECT_THAT(harness.refined_again, ElementsAre(0, 1, 2, 3, 4));
  for (const int64_t id : {0, 1, 2, 3}) {
    EXPECT_THAT(CallsOf(harness.patch_match, "photometric", id), SizeIs(1)) << "estimated anew with the views of now";
    const auto passes = CallsOf(harness.patch_match, "geometric", id);
    ASSERT_THAT(passes, SizeIs(4));
    EXPECT_THAT(passes[0].source_depths, AllOf(SizeIs(4), Each(kFastDepth))) << "the first pass reads no refined map";
    EXPECT_EQ(passes[0].start_depth, kFastDepth);
    EXPECT_THAT(passes[1].source_depths, Each(kRefinedDepth)) << "all have passed once";
    EXPECT_THAT(passes[1].geometric_pass, 1);
    EXPECT_EQ(passes[2].geometric_pass, 0) << "once more";
    EXPECT_EQ(passes[2].start_depth, kRefinedDepth) << "from where it is";
  }
  harness.refined_again.clear();
  harness.Flush();
  EXPECT_THAT(harness.refined_again, IsEmpty()) << "nothing more has come";
}

TEST(DenseMapperFlushAgainTest, WhatReadsBetterMapsOnlyThenIsNotDoneAgainLater) {
  MapperHarness harness(RefiningAgain(10));
  AddFive(&harness);
  harness.Flush();
  harness.refined_again.clear();
  for (int id = 5; id < 20; ++id) harness.Add(WallFrame(id, 7.0 + 0.35 * id));  // elsewhere
  EXPECT_THAT(harness.refined_again, Each(testing::Gt(4)));
}

TEST(DenseMapperFlushAgainTest, WhatHadBetterViewsStaysAsItIs) {
  DenseMapperOptions options = RefiningAgain(6);
  options.source_views.max_source_views = 3;
  MapperHarness harness(options);
  for (int id = 0; id < 20; ++id) harness.Add(WallFrame(id));
  harness.refined_again.clear();
  harness.Flush();
  EXPECT_THAT(harness.refined_again, Not(Contains(14))) << "12 and 13 have left the window";
}

TEST(DenseMapperFlushAgainTest, OneThatFailsIsToldAndStopsNobody) {
  for (const char* pass : {"photometric", "geometric"}) {
    MapperHarness harness(RefiningAgain(10));
    AddFive(&harness);
    harness.patch_match.before_answer = [&](const FakePatchMatch::Call& call) {
      if (call.pass == pass && call.reference == 1) throw ProcessingError("device lost");
    };
    EXPECT_THAT(harness.Flush(), ElementsAre("refined 4"));
    EXPECT_THAT(harness.problems,
                AllOf(SizeIs(1), Contains(AllOf(HasSubstr("keyframe 1 could not be"), HasSubstr("device lost")))));
    if (std::string(pass) == "photometric") {
      EXPECT_THAT(harness.refined_again, ElementsAre(0, 1, 2, 3, 4)) << "it goes on with the fast map of before";
    } else {
      EXPECT_THAT(harness.refined_again, ElementsAre(0, 2, 3, 4));
    }
  }
}

TEST(DenseMapperFlushAgainTest, EndsAtOnceWhenNobodyWantsMore) {
  for (const char* pass : {"photometric", "geometric"}) {
    MapperHarness harness(RefiningAgain(10));
    AddFive(&harness);
    harness.mapper.Flush(false);
    harness.patch_match.calls.clear();
    harness.patch_match.before_answer = [&](const FakePatchMatch::Call& call) {
      if (call.pass == pass) harness.unwanted = {0, 1, 2, 3, 4};
    };
    harness.Flush();
    EXPECT_THAT(harness.refined_again, IsEmpty());
    const auto& calls = harness.patch_match.calls;
    const auto is_of_pass = [&](const FakePatchMatch::Call& call) { return call.pass == pass; };
    EXPECT_EQ(std::count_if(calls.begin(), calls.end(), is_of_pass), 1);
    EXPECT_EQ(calls.back().pass, pass);
  }
}

}  // namespace
}  // namespace acmp
