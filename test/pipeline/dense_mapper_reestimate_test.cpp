// Keyframes that are estimated anew when better source views of them have come.

#include <algorithm>

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

constexpr float kFastDepth = static_cast<float>(kWallDepth * FakePatchMatch::kFastError);
constexpr float kRefinedDepth = static_cast<float>(kWallDepth);

DenseMapperOptions Options(int lookahead, int reestimates) {
  DenseMapperOptions options = FakeOptions(10, lookahead);
  options.reestimates = reestimates;
  return options;
}

/// Three keyframes with 1.4 degrees between neighbours: poor views of each other.
void AddPoorStart(MapperHarness* harness) {
  for (int id = 0; id < 3; ++id) harness->Add(WallFrame(id, 0.1 * id));
}

TEST(DenseMapperReestimateTest, TheKeyframesThatGainMostAreEstimatedAnewWithTheNewOne) {
  for (int reestimates = 0; reestimates <= 3; ++reestimates) {
    MapperHarness harness(Options(2, reestimates));
    AddPoorStart(&harness);
    harness.patch_match.calls.clear();
    EXPECT_THAT(harness.Add(WallFrame(3, 0.6)), ElementsAre("fast 3", "refined 1"));
    std::vector<int64_t> anew;
    for (const auto& call : harness.patch_match.calls) {
      if (call.pass != "photometric" || call.reference == 3) continue;
      anew.push_back(call.reference);
      EXPECT_THAT(call.sources, Contains(3));
    }
    EXPECT_THAT(anew, SizeIs(reestimates));
    harness.TakeEvents();
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
  harness.Add(WallFrame(5, 5 * 0.35 - 0.05));  // where the last one stands, nearly
  for (const int64_t id : {0, 1, 2, 3}) EXPECT_THAT(CallsOf(harness.patch_match, "photometric", id), IsEmpty()) << id;
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
  harness.Add(WallFrame(3, 0.6));
  harness.Flush();
  const KeyframeDepth& refined = *harness.refined.at(1);
  ASSERT_EQ(refined.frame->id, 1);
  ASSERT_THAT(CallsOf(harness.patch_match, "photometric", 1), SizeIs(2));
  EXPECT_EQ(refined.times.kernels_ms, 4) << "two initial estimates, two geometric passes";
}

TEST(DenseMapperReestimateTest, WhereItFailsOthersReadWhatTheyReadBefore) {
  MapperHarness harness(Options(3, 9));
  for (int id = 0; id < 5; ++id) harness.Add(WallFrame(id, 0.1 * id));
  harness.patch_match.before_answer = [](const FakePatchMatch::Call& call) {
    if (call.pass == "photometric" && call.reference < 5) throw ProcessingError("device lost");
  };
  harness.patch_match.calls.clear();
  EXPECT_THAT(harness.Add(WallFrame(5, 0.9)), ElementsAre("fast 5", "refined 2"));
  EXPECT_THAT(harness.problems,
              AllOf(Not(IsEmpty()), Each(AllOf(HasSubstr("reestimate_failed: keyframe "), HasSubstr("device lost")))));
  const auto call = CallsOf(harness.patch_match, "geometric", 2).at(0);
  EXPECT_THAT(call.source_depths, AllOf(Contains(kRefinedDepth), Each(testing::Gt(0.0f))));
}

}  // namespace
}  // namespace acmp
