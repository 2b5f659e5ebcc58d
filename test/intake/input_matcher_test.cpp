#include "acmp_mapping/intake/input_matcher.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "intake/samples.h"

namespace acmp {
namespace {

SparseCloudPtr CloudAt(int64_t stamp_ns, double x = 0) {
  auto cloud = std::make_shared<SparseCloud>();
  cloud->stamp_ns = stamp_ns;
  cloud->points = {{x, 0, 0}};
  return cloud;
}

/// A matcher that knows the camera and waits for no clouds.
InputMatcher MakeMatcher(const InputMatcherOptions& options = {}) {
  InputMatcher matcher(options);
  matcher.set_obstacle(std::nullopt);
  matcher.set_clouds_expected(false);
  return matcher;
}

std::vector<MatchedInput> Matches(const std::vector<MatchEvent>& events) {
  std::vector<MatchedInput> matches;
  for (const MatchEvent& event : events) {
    if (const auto* match = std::get_if<MatchedInput>(&event)) matches.push_back(*match);
  }
  return matches;
}

std::vector<std::string> DropReasons(const std::vector<MatchEvent>& events) {
  std::vector<std::string> reasons;
  for (const MatchEvent& event : events) {
    if (const auto* drop = std::get_if<RejectedInput>(&event)) reasons.push_back(drop->reason);
  }
  return reasons;
}

std::vector<int64_t> Stamps(const std::vector<MatchEvent>& events) {
  std::vector<int64_t> stamps;
  for (const MatchedInput& match : Matches(events)) stamps.push_back(match.image.stamp_ns);
  return stamps;
}

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(InputMatcher, MatchesStampsThatWentThroughADouble) {
  InputMatcher matcher = MakeMatcher();
  const int64_t rounded = static_cast<int64_t>(static_cast<double>(kT0) * 1e-9 * 1e9);
  ASSERT_NE(rounded, kT0);  // or the test shows nothing
  matcher.AddImage({kT0, nullptr});
  matcher.AddPose(PoseAt(rounded));
  EXPECT_THAT(Stamps(matcher.Take(0)), ElementsAre(kT0));
}

TEST(InputMatcher, MatchesAtTheToleranceAndNotBeyond) {
  for (const int64_t sign : {-1, 1}) {
    InputMatcher matcher = MakeMatcher();
    matcher.AddImage({kT0, nullptr});
    matcher.AddPose(PoseAt(kT0 + sign * kMs));
    EXPECT_THAT(Stamps(matcher.Take(0)), ElementsAre(kT0));
    matcher.AddImage({kT0 + kS, nullptr});
    matcher.AddPose(PoseAt(kT0 + kS + sign * (kMs + 1)));
    EXPECT_THAT(Stamps(matcher.Take(0)), IsEmpty());
  }
}

TEST(InputMatcher, AcceptsPosesBeforeAndAfterTheirImage) {
  InputMatcher matcher = MakeMatcher();
  matcher.AddPose(PoseAt(kT0));
  EXPECT_THAT(matcher.Take(0), IsEmpty());
  matcher.AddImage({kT0, nullptr});
  EXPECT_THAT(Stamps(matcher.Take(0)), ElementsAre(kT0));
  // A keyframe pose that is two images late: the pose triggers, the image waited.
  for (int i = 1; i <= 3; ++i) matcher.AddImage({kT0 + i * 50 * kMs, nullptr});
  EXPECT_THAT(matcher.Take(0), IsEmpty());
  matcher.AddPose(PoseAt(kT0 + 50 * kMs));
  EXPECT_THAT(Stamps(matcher.Take(0)), ElementsAre(kT0 + 50 * kMs));
}

TEST(InputMatcher, TakesTheNearestOfTwoPoses) {
  InputMatcherOptions options;
  options.sync_tolerance_s = 0.02;
  InputMatcher matcher = MakeMatcher(options);
  matcher.AddPose(PoseAt(kT0 - 15 * kMs, 1));
  matcher.AddImage({kT0, nullptr});
  EXPECT_THAT(matcher.Take(0), IsEmpty()) << "a nearer pose may still come";
  matcher.AddPose(PoseAt(kT0 + 5 * kMs, 2));
  const auto matches = Matches(matcher.Take(0));
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].pose.received.translation().x(), 2);
}

TEST(InputMatcher, UsesAPoseOnce) {
  InputMatcherOptions options;
  options.sync_tolerance_s = 0.02;
  InputMatcher matcher = MakeMatcher(options);
  matcher.AddImage({kT0, nullptr});
  matcher.AddPose(PoseAt(kT0 + 8 * kMs));
  EXPECT_THAT(Stamps(matcher.Take(0)), ElementsAre(kT0));
  matcher.AddImage({kT0 + 16 * kMs, nullptr});
  EXPECT_THAT(Stamps(matcher.Take(0)), IsEmpty());
}

TEST(InputMatcher, DropsOvertakenImagesAndNamesTheNearestPose) {
  InputMatcher matcher = MakeMatcher();
  matcher.AddImage({kT0, nullptr});
  matcher.AddImage({kT0 + 40 * kMs, nullptr});
  matcher.AddPose(PoseAt(kT0 + 40 * kMs));
  const auto events = matcher.Take(0);
  EXPECT_THAT(Stamps(events), ElementsAre(kT0 + 40 * kMs));
  EXPECT_THAT(DropReasons(events), ElementsAre("no_pose"));
  EXPECT_THAT(std::get<RejectedInput>(events[0]).message,
              ::testing::AllOf(::testing::HasSubstr("1403636579.763555500"), ::testing::HasSubstr("40 ms")));
  ASSERT_TRUE(matcher.last_gap());
  EXPECT_EQ(*matcher.last_gap()->gap_ns, 40 * kMs);
}

TEST(InputMatcher, KeepsAtMostTheCapacityOfImages) {
  InputMatcherOptions options;
  options.image_capacity = 3;
  InputMatcher matcher = MakeMatcher(options);
  std::vector<std::string> reasons;
  for (int i = 0; i < 10; ++i) {
    matcher.AddImage({kT0 + i * 40 * kMs, nullptr});
    for (const std::string& reason : DropReasons(matcher.Take(0))) reasons.push_back(reason);
  }
  EXPECT_EQ(matcher.waiting_images(), 3u);
  EXPECT_THAT(reasons, ElementsAre("no_pose", "no_pose", "no_pose", "no_pose", "no_pose", "no_pose", "no_pose"));
  EXPECT_FALSE(matcher.last_gap()->gap_ns) << "there was no pose at all";
}

TEST(InputMatcher, WaitsForTheCamera) {
  InputMatcherOptions options;
  options.image_capacity = 1;
  InputMatcher matcher = MakeMatcher(options);
  matcher.set_obstacle(RejectedInput{"no_camera_info", "no usable camera_info has been received"});
  matcher.AddImage({kT0, nullptr});
  matcher.AddPose(PoseAt(kT0));
  EXPECT_THAT(matcher.Take(0), IsEmpty());
  matcher.AddImage({kT0 + 40 * kMs, nullptr});
  matcher.AddPose(PoseAt(kT0 + 40 * kMs));
  EXPECT_THAT(DropReasons(matcher.Take(0)), ElementsAre("no_camera_info"));
  matcher.set_obstacle(std::nullopt);
  EXPECT_THAT(Stamps(matcher.Take(0)), ElementsAre(kT0 + 40 * kMs));
}

TEST(InputMatcher, RefusesDuplicateAndLateImages) {
  InputMatcher matcher = MakeMatcher();
  matcher.AddImage({kT0, nullptr});
  matcher.AddImage({kT0, nullptr});
  EXPECT_THAT(DropReasons(matcher.Take(0)), ElementsAre("duplicate_image"));
  matcher.AddPose(PoseAt(kT0));
  EXPECT_THAT(Stamps(matcher.Take(0)), ElementsAre(kT0));
  matcher.AddImage({kT0, nullptr});
  matcher.AddImage({kT0 - 40 * kMs, nullptr});
  EXPECT_THAT(DropReasons(matcher.Take(0)), ElementsAre("duplicate_image", "late_image"));
}

TEST(InputMatcher, WaitsForTheCloudOfTheSameStampButNotForever) {
  InputMatcher matcher = MakeMatcher();
  matcher.set_clouds_expected(true);
  matcher.AddImage({kT0, nullptr});
  matcher.AddPose(PoseAt(kT0));
  EXPECT_THAT(matcher.Take(10.0), IsEmpty());
  matcher.AddCloud(CloudAt(kT0));
  auto matches = Matches(matcher.Take(10.05));
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].cloud->stamp_ns, kT0);
  ASSERT_TRUE(matches[0].cloud_pose);

  matcher.AddImage({kT0 + 100 * kMs, nullptr});
  matcher.AddPose(PoseAt(kT0 + 100 * kMs));
  EXPECT_THAT(matcher.Take(20.0), IsEmpty());
  EXPECT_THAT(matcher.Take(20.09), IsEmpty());
  matches = Matches(matcher.Take(20.1));
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].cloud->stamp_ns, kT0) << "within sparse_tolerance";
  EXPECT_TRUE(matches[0].cloud_pose) << "the pose at the cloud's own stamp";
}

TEST(InputMatcher, TakesTheNearestCloudElseTheLast) {
  InputMatcher matcher = MakeMatcher();
  for (const int64_t offset : {-300 * kMs, -100 * kMs, -900 * kMs}) matcher.AddCloud(CloudAt(kT0 + offset));
  matcher.AddImage({kT0, nullptr});
  matcher.AddPose(PoseAt(kT0));
  EXPECT_EQ(Matches(matcher.Take(0)).at(0).cloud->stamp_ns, kT0 - 100 * kMs);
  matcher.AddImage({kT0 + 10 * kS, nullptr});
  matcher.AddPose(PoseAt(kT0 + 10 * kS));
  const auto matches = Matches(matcher.Take(0));
  EXPECT_EQ(matches.at(0).cloud->stamp_ns, kT0 - 900 * kMs) << "the last to arrive";
  EXPECT_FALSE(matches.at(0).cloud_pose) << "no pose was ever given for that stamp";
}

/// Two runs of the same 2 s recording; the parameter says in which order image, pose and cloud of a stamp come.
class LoopingBag : public ::testing::TestWithParam<std::string> {};

TEST_P(LoopingBag, LosesNothing) {
  constexpr int kImages = 20;
  InputMatcher matcher = MakeMatcher();
  matcher.set_clouds_expected(true);
  std::vector<MatchEvent> events;
  const auto add = [&](char stream, int index) {
    const int64_t stamp = kT0 + index % kImages * 100 * kMs;
    const double run = index < kImages ? 0 : 1;
    if (stream == 'i') matcher.AddImage({stamp, nullptr});
    if (stream == 'p') matcher.AddPose(PoseAt(stamp, run));
    if (stream == 'c') matcher.AddCloud(CloudAt(stamp, run));
    for (MatchEvent& event : matcher.Take(0)) events.push_back(std::move(event));
  };
  for (int i = 0; i < 2 * kImages; ++i) {
    for (const char stream : GetParam()) add(stream, i);
  }
  const auto matches = Matches(events);
  ASSERT_EQ(matches.size(), 2u * kImages);
  for (int i = 0; i < 2 * kImages; ++i) {
    const MatchedInput& match = matches[static_cast<size_t>(i)];
    const double run = i < kImages ? 0 : 1;
    EXPECT_EQ(match.image.stamp_ns, kT0 + i % kImages * 100 * kMs);
    EXPECT_EQ(match.pose.received.translation().x(), run) << "a pose of the other run at " << i;
    ASSERT_TRUE(match.cloud) << "at " << i;
    EXPECT_EQ(match.cloud->stamp_ns, match.image.stamp_ns) << "another image's cloud at " << i;
    EXPECT_EQ(match.cloud->points[0].x(), run) << "a cloud of the other run at " << i;
  }
  const auto jumps =
      std::count_if(events.begin(), events.end(), [](const auto& e) { return std::holds_alternative<TimeJump>(e); });
  EXPECT_EQ(jumps, 1);
  EXPECT_THAT(DropReasons(events), IsEmpty());
  EXPECT_TRUE(std::holds_alternative<TimeJump>(events[kImages])) << "between the runs";
}

INSTANTIATE_TEST_SUITE_P(EachOrderOfTheStreams, LoopingBag,
                         ::testing::Values("icp", "ipc", "cip", "cpi", "pic", "pci"));

TEST(InputMatcher, LosesNothingOfAShortRunThatComesWholeBeforeItsFirstImage) {
  constexpr int kImages = 5;
  InputMatcher matcher = MakeMatcher();
  matcher.set_clouds_expected(true);
  std::vector<MatchEvent> events;
  for (const double run : {0.0, 1.0}) {
    for (int i = 0; i < kImages; ++i) matcher.AddPose(PoseAt(kT0 + i * 100 * kMs, run));
    for (int i = 0; i < kImages; ++i) matcher.AddCloud(CloudAt(kT0 + i * 100 * kMs, run));
    for (int i = 0; i < kImages; ++i) {
      matcher.AddImage({kT0 + i * 100 * kMs, nullptr});
      for (MatchEvent& event : matcher.Take(0)) events.push_back(std::move(event));
    }
  }
  const auto matches = Matches(events);
  ASSERT_EQ(matches.size(), 2u * kImages);
  for (size_t i = 0; i < matches.size(); ++i) {
    const double run = i < kImages ? 0 : 1;
    EXPECT_EQ(matches[i].pose.received.translation().x(), run) << "a pose of the other run at " << i;
    ASSERT_TRUE(matches[i].cloud) << "at " << i;
    EXPECT_EQ(matches[i].cloud->stamp_ns, matches[i].image.stamp_ns);
    EXPECT_EQ(matches[i].cloud->points[0].x(), run) << "a cloud of the other run at " << i;
  }
  EXPECT_THAT(DropReasons(events), IsEmpty());
}

TEST(InputMatcher, KeepsWhatCameBeforeTheLastImageOfTheOldRun) {
  InputMatcher matcher = MakeMatcher();
  matcher.set_clouds_expected(true);
  const int64_t last = kT0 + 5 * kS;
  matcher.AddPose(PoseAt(last, 0));
  matcher.AddCloud(CloudAt(last, 0));
  matcher.AddPose(PoseAt(kT0, 1));
  matcher.AddCloud(CloudAt(kT0, 1));
  matcher.AddImage({last, nullptr});  // the greatest message, and the slowest
  matcher.AddImage({kT0, nullptr});
  const auto matches = Matches(matcher.Take(0));
  ASSERT_EQ(matches.size(), 2u);
  for (const size_t run : {0, 1}) {
    EXPECT_EQ(matches[run].pose.received.translation().x(), run);
    ASSERT_TRUE(matches[run].cloud);
    EXPECT_EQ(matches[run].cloud->points[0].x(), run);
  }
}

TEST(InputMatcher, TakesNoCloudOfAShorterRunBefore) {
  InputMatcher matcher = MakeMatcher();
  SparseCloudPtr late;  // each cloud comes after the next image, the last one of a run after the next run's first
  const auto play = [&](double run, int seconds) {
    for (int i = 0; i < seconds; ++i) {
      matcher.AddPose(PoseAt(kT0 + i * kS, run));
      matcher.AddImage({kT0 + i * kS, nullptr});
      const auto matches = Matches(matcher.Take(0));
      ASSERT_EQ(matches.size(), 1u);
      if (i == 0) {
        EXPECT_FALSE(matches[0].cloud) << "none of run " << run << " has come";
      }
      if (late) matcher.AddCloud(late);
      late = CloudAt(kT0 + i * kS, run);
    }
  };
  play(0, 10);
  play(1, 5);
  play(2, 5);
}

TEST(InputMatcher, TakesNothingOfTheOldRunThatCameAfterTheJump) {
  InputMatcher matcher = MakeMatcher();
  matcher.set_clouds_expected(true);
  const int64_t last = kT0 + 5 * kS;
  for (const int64_t stamp : {kT0, last - 100 * kMs}) {
    matcher.AddPose(PoseAt(stamp, 0));
    matcher.AddCloud(CloudAt(stamp, 0));
    matcher.AddImage({stamp, nullptr});
  }
  ASSERT_EQ(Matches(matcher.Take(0)).size(), 2u);
  matcher.AddImage({last, nullptr});
  matcher.AddImage({kT0, nullptr});
  matcher.AddCloud(CloudAt(last, 0));  // late
  matcher.AddPose(PoseAt(last, 0));
  matcher.AddPose(PoseAt(kT0, 1));
  EXPECT_THAT(Stamps(matcher.Take(1)), IsEmpty()) << "its own cloud may still come";
  matcher.AddCloud(CloudAt(kT0, 1));
  const auto matches = Matches(matcher.Take(1));
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].pose.received.translation().x(), 1);
  EXPECT_EQ(matches[0].cloud->points[0].x(), 1);
}

TEST(InputMatcher, ForgetsTheOldRunAtAJump) {
  InputMatcher matcher = MakeMatcher();
  matcher.AddCloud(CloudAt(kT0 + 5 * kS));
  matcher.AddPose(PoseAt(kT0));  // old run: must not match an image of the new one
  matcher.AddImage({kT0 + 5 * kS, nullptr});
  matcher.AddImage({kT0, nullptr});
  auto events = matcher.Take(0);
  EXPECT_THAT(Stamps(events), IsEmpty());
  EXPECT_THAT(DropReasons(events), ElementsAre("no_pose")) << "it has waited for one in vain";
  matcher.AddPose(PoseAt(kT0));
  const auto matches = Matches(matcher.Take(0));
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].cloud, nullptr);
}

TEST(InputMatcher, ClearReportsWhatWaited) {
  InputMatcher matcher = MakeMatcher();
  matcher.AddImage({kT0, nullptr});
  matcher.Clear("reset");
  EXPECT_THAT(DropReasons(matcher.Take(0)), ElementsAre("reset"));
  EXPECT_EQ(matcher.waiting_images(), 0u);
  matcher.AddImage({kT0 - 100 * kS, nullptr});
  EXPECT_THAT(matcher.Take(0), IsEmpty()) << "no jump: nothing is remembered";
}

}  // namespace
}  // namespace acmp
