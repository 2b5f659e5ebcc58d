// What is matched, in which order and after which wait; of recordings that begin anew nothing is mixed.

#include "acmp_mapping/intake/input_matcher.h"

#include "intake/samples.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using Picture = std::shared_ptr<const EncodedImage>;

/// Something that can be told apart. The matcher does not look into it.
Picture MakePicture() {
  const auto owner = std::make_shared<int>();
  return {owner, reinterpret_cast<const EncodedImage*>(owner.get())};
}

/// What came out, in order.
struct Taken {
  std::vector<int64_t> stamps;  ///< of matches, as the next ones
  std::vector<double> poses;    ///< x
  std::vector<double> clouds;   ///< x; -1: none
  std::vector<Picture> masks, prior_depths;
  std::vector<MatchedInput> matches;
  std::vector<std::string> reasons;  ///< of what was rejected
  std::string message;               ///< the last one
  size_t jumps = 0;
};

/// A matcher that knows the camera and waits for no clouds. Stamps are nanoseconds after kT0.
class Matching {
 public:
  explicit Matching(const InputMatcherOptions& options = {}) : matcher(options) {
    matcher.set_obstacle(std::nullopt);
    matcher.set_clouds_expected(false);
  }

  void Image(int64_t after_ns) { matcher.AddImage({kT0 + after_ns, nullptr}); }
  void Pose(int64_t after_ns, double x = 0) { matcher.AddPose(PoseAt(kT0 + after_ns, x)); }
  void Cloud(int64_t after_ns, double x = 0) {
    auto cloud = std::make_shared<SparseCloud>();
    cloud->stamp_ns = kT0 + after_ns;
    cloud->points = {{x, 0, 0}};
    matcher.AddCloud(std::move(cloud));
  }
  void Posed(int64_t after_ns, double x = 0) {
    Image(after_ns);
    Pose(after_ns, x);
  }
  Picture Companion(size_t stream, int64_t after_ns) {
    const Picture picture = MakePicture();
    matcher.AddCompanion(stream, {kT0 + after_ns, picture});
    return picture;
  }

  Taken Take(double now_s = 0) { return Sort(matcher.Take(now_s)); }
  static Taken Sort(const std::vector<MatchEvent>& events) {
    Taken taken;
    for (const MatchEvent& event : events) {
      if (const auto* match = std::get_if<MatchedInput>(&event)) {
        taken.stamps.push_back(match->image.stamp_ns - kT0);
        taken.poses.push_back(match->pose.received.translation().x());
        taken.clouds.push_back(match->cloud ? match->cloud->points[0].x() : -1);
        taken.masks.push_back(match->companions.at(kMaskStream));
        taken.prior_depths.push_back(match->companions.at(kPriorDepthStream));
        taken.matches.push_back(*match);
      } else if (const auto* rejected = std::get_if<RejectedInput>(&event)) {
        taken.reasons.push_back(rejected->reason);
        taken.message = rejected->message;
      } else {
        ++taken.jumps;
      }
    }
    return taken;
  }

  InputMatcher matcher;
};

InputMatcherOptions WithTolerance(double sync_tolerance_s) {
  InputMatcherOptions options;
  options.sync_tolerance_s = sync_tolerance_s;
  return options;
}

constexpr int64_t kThroughADouble = static_cast<int64_t>(static_cast<double>(kT0) * 1e-9 * 1e9) - kT0;
static_assert(kThroughADouble != 0, "or the tests show nothing");

TEST(InputMatcher, MatchesWithinTheToleranceBeforeAndAfter) {
  for (const int64_t gap : {kThroughADouble, kMs, -kMs}) {
    Matching m;
    m.Image(0);
    m.Pose(gap);
    EXPECT_THAT(m.Take().stamps, ElementsAre(0)) << gap;
    m.Image(kS);
    m.Pose(kS + (gap > 0 ? kMs + 1 : -kMs - 1));
    EXPECT_THAT(m.Take().stamps, IsEmpty());
  }
}

TEST(InputMatcher, TakesThePoseBetweenTwoWithinTheTolerance) {
  Matching m(WithTolerance(0.02));
  m.Pose(-15 * kMs, 1);
  m.Image(0);
  EXPECT_THAT(m.Take().stamps, IsEmpty()) << "a later pose may still come";
  m.Pose(5 * kMs, 2);
  m.Image(2 * kMs);
  const std::vector<double> between = m.Take().poses;
  ASSERT_EQ(between.size(), 2u);
  EXPECT_NEAR(between[0], 1.75, 1e-12);
  EXPECT_NEAR(between[1], 1.85, 1e-12) << "a pose may be beside several images";
  m.Image(5 * kMs + kMs / 2);
  EXPECT_THAT(m.Take().poses, ElementsAre(2)) << "of its stamp";
  const PoseUse& use = m.matcher.pose_use();
  EXPECT_EQ(use.same, 1u);
  EXPECT_EQ(use.between, 2u);
  EXPECT_EQ(use.nearest, 0u);
  EXPECT_EQ(use.farthest_ns, 5 * kMs);
}

TEST(InputMatcher, TakesTheNearestPoseWhereTheOtherIsTooFarAndEachOnce) {
  Matching m(WithTolerance(0.02));
  m.Pose(-15 * kMs, 1);
  m.Image(0);
  m.Image(2 * kMs);
  m.Pose(50 * kMs, 2);
  EXPECT_THAT(m.Take().poses, ElementsAre(1));
  EXPECT_EQ(m.matcher.pose_use().nearest, 1u);
  EXPECT_EQ(m.matcher.pose_use().farthest_ns, 15 * kMs);
}

TEST(InputMatcher, DoesNotMixPosesOfTwoWorlds) {
  Matching m(WithTolerance(0.02));
  PoseSample pose = PoseAt(kT0 - 6 * kMs, 1);
  pose.world_frame = "map";
  m.matcher.AddPose(pose);
  m.Image(0);
  m.Pose(5 * kMs, 2);
  EXPECT_THAT(m.Take().poses, ElementsAre(2));
}

TEST(InputMatcher, DropsOvertakenImagesAndNamesTheNearestPose) {
  Matching m;
  m.Image(0);
  m.Posed(40 * kMs);
  const Taken taken = m.Take();
  EXPECT_THAT(taken.stamps, ElementsAre(40 * kMs));
  EXPECT_THAT(taken.reasons, ElementsAre("no_pose"));
  EXPECT_THAT(taken.message, HasAll("1403636579.763555500", "40 ms"));
  EXPECT_EQ(m.matcher.last_gap()->gap_ns, 40 * kMs);
}

TEST(InputMatcher, WaitsForTheCamera) {
  InputMatcherOptions options;
  options.image_capacity = 1;
  Matching m(options);
  m.matcher.set_obstacle(RejectedInput{"no_camera_info", "no usable camera_info has been received"});
  m.Posed(0);
  EXPECT_THAT(m.Take().stamps, IsEmpty());
  m.Posed(40 * kMs);
  EXPECT_THAT(m.Take().reasons, ElementsAre("no_camera_info"));
  m.matcher.set_obstacle(std::nullopt);
  EXPECT_THAT(m.Take().stamps, ElementsAre(40 * kMs));
}

TEST(InputMatcher, RefusesDuplicateAndLateImages) {
  Matching m;
  m.Image(0);
  m.Image(0);
  EXPECT_THAT(m.Take().reasons, ElementsAre("duplicate_image"));
  m.Pose(0);
  EXPECT_THAT(m.Take().stamps, ElementsAre(0));
  m.Image(0);
  m.Image(-40 * kMs);
  EXPECT_THAT(m.Take().reasons, ElementsAre("duplicate_image", "late_image"));
}

TEST(InputMatcher, TellsOfASecondPoseOfOneStampAndUsesTheFirst) {
  Matching m;
  m.Pose(0, 1);
  m.Pose(0, 1);
  EXPECT_THAT(m.Take().reasons, IsEmpty()) << "sent again";
  m.Pose(40 * kMs, 2);
  m.Pose(0, 1.5);  // of a second publisher, after the next one of the first
  m.Pose(40 * kMs, 2.25);
  const Taken taken = m.Take();
  EXPECT_THAT(taken.reasons, ElementsAre("duplicate_pose", "duplicate_pose"));
  EXPECT_THAT(taken.message, HasSubstr("0.25 from the first"));
  m.Image(0);
  m.Image(40 * kMs);
  EXPECT_THAT(m.Take().poses, ElementsAre(1, 2));
  m.Pose(40 * kMs, 2.5);
  EXPECT_THAT(m.Take().reasons, ElementsAre("duplicate_pose")) << "also when the first has been used";
}

TEST(InputMatcher, PosesOfARecordingThatBeginsAnewAreNoSecondOnes) {
  Matching m;
  for (int i = 0; i < 10; ++i) m.Posed(i * 40 * kMs, i);
  EXPECT_EQ(m.Take().stamps.size(), 10u);
  m.Pose(0, 100);  // before the image that shows that time went back
  m.Image(0);
  const Taken taken = m.Take();
  EXPECT_EQ(taken.jumps, 1u);
  EXPECT_THAT(taken.reasons, IsEmpty());
  EXPECT_THAT(taken.poses, ElementsAre(100));
}

TEST(InputMatcher, ClearReportsWhatWaitedAndRemembersNothing) {
  Matching m;
  m.Image(0);
  m.matcher.Clear("reset");
  EXPECT_THAT(m.Take().reasons, ElementsAre("reset"));
  EXPECT_EQ(m.matcher.waiting_images(), 0u);
  m.Image(-100 * kS);
  EXPECT_EQ(m.Take().jumps, 0u);
}

TEST(InputMatcher, WaitsForTheCloudOfTheSameStampButNotForever) {
  Matching m;
  m.matcher.set_clouds_expected(true);
  m.Posed(0);
  EXPECT_THAT(m.Take(10.0).stamps, IsEmpty());
  m.Cloud(0, 1);
  const Taken at_once = m.Take(10.05);
  EXPECT_THAT(at_once.clouds, ElementsAre(1));
  EXPECT_TRUE(at_once.matches.at(0).cloud_pose);
  m.Posed(100 * kMs);
  EXPECT_THAT(m.Take(20.0).stamps, IsEmpty());
  EXPECT_THAT(m.Take(20.09).stamps, IsEmpty());
  const Taken later = m.Take(20.1);
  EXPECT_THAT(later.clouds, ElementsAre(1)) << "within half a second";
  EXPECT_TRUE(later.matches.at(0).cloud_pose) << "the pose at the cloud's own stamp";
}

TEST(InputMatcher, TakesTheNearestCloudElseTheLastToArrive) {
  Matching m;
  m.Cloud(-300 * kMs, 1);
  m.Cloud(-100 * kMs, 2);
  m.Cloud(-900 * kMs, 3);
  m.Posed(0);
  EXPECT_THAT(m.Take().clouds, ElementsAre(2));
  m.Posed(10 * kS);
  const Taken taken = m.Take();
  EXPECT_THAT(taken.clouds, ElementsAre(3));
  EXPECT_FALSE(taken.matches.at(0).cloud_pose) << "no pose was ever given for that stamp";
}

/// Masks are expected; images are posed.
struct MaskedMatching : Matching {
  MaskedMatching() { matcher.set_companion_expected(kMaskStream, true); }
};

TEST(Companions, AnImageWaitsForTheMaskOfItsStamp) {
  MaskedMatching m;
  m.Posed(0);
  EXPECT_THAT(m.Take(10).stamps, IsEmpty());
  m.Companion(kMaskStream, -30 * kMs);  // of an earlier image
  EXPECT_THAT(m.Take(10.1).stamps, IsEmpty());
  const Picture mask = m.Companion(kMaskStream, kThroughADouble);
  const Taken taken = m.Take(10.2);
  EXPECT_THAT(taken.masks, ElementsAre(mask));
  EXPECT_THAT(taken.reasons, IsEmpty());
}

TEST(Companions, NoImageWaitsLongerThanMaskWaitNorOnceThatOfALaterOneIsThere) {
  MaskedMatching waiting;
  waiting.Posed(0);
  waiting.Posed(100 * kMs);
  EXPECT_THAT(waiting.Take(10).stamps, IsEmpty());
  EXPECT_THAT(waiting.Take(10.49).stamps, IsEmpty());
  const Taken both = waiting.Take(10.5);
  EXPECT_THAT(both.masks, ElementsAre(nullptr, nullptr)) << "they wait at the same time";
  EXPECT_THAT(both.reasons, ElementsAre("no_mask", "no_mask"));
  MaskedMatching overtaken;
  overtaken.Posed(0);
  overtaken.Posed(100 * kMs);
  const Picture mask = overtaken.Companion(kMaskStream, 100 * kMs);
  EXPECT_THAT(overtaken.Take().masks, ElementsAre(nullptr, mask));
}

TEST(Companions, OneOfTheFutureTellsNothingOfThoseToCome) {
  MaskedMatching m;
  m.Companion(kMaskStream, 60 * kS);
  for (int i = 0; i < 3; ++i) {
    m.Companion(kMaskStream, (2 * i - 1) * kS);
    m.Posed(2 * i * kS);
    EXPECT_THAT(m.Take(i).stamps, IsEmpty()) << "its own may come yet";
    const Picture mask = m.Companion(kMaskStream, 2 * i * kS);
    EXPECT_THAT(m.Take(i + 0.1).masks, ElementsAre(mask));
  }
}

TEST(Companions, WithoutPublisherOrAtAFlushNobodyWaits) {
  MaskedMatching m;
  m.Posed(0);
  EXPECT_THAT(Matching::Sort(m.matcher.TakeAll()).stamps, ElementsAre(0));
  m.matcher.set_companion_expected(kMaskStream, false);
  m.Posed(kS);
  const Taken taken = m.Take();
  EXPECT_THAT(taken.masks, ElementsAre(nullptr));
  EXPECT_THAT(taken.reasons, IsEmpty());
}

TEST(Companions, EachStreamIsWaitedForBesideTheOthers) {
  MaskedMatching m;
  m.matcher.set_companion_expected(kPriorDepthStream, true);
  m.Posed(0);
  m.Posed(100 * kMs);
  const Picture mask = m.Companion(kMaskStream, 0), later = m.Companion(kMaskStream, 100 * kMs);
  EXPECT_THAT(m.Take(10).stamps, IsEmpty());
  const Picture depth = m.Companion(kPriorDepthStream, 0);
  const Taken first = m.Take(10.1);
  EXPECT_THAT(first.masks, ElementsAre(mask));
  EXPECT_THAT(first.prior_depths, ElementsAre(depth));
  m.Companion(kPriorDepthStream, 50 * kMs);  // of no image
  EXPECT_THAT(m.Take(10.4).stamps, IsEmpty());
  const Taken second = m.Take(10.5);
  EXPECT_THAT(second.masks, ElementsAre(later));
  EXPECT_THAT(second.prior_depths, ElementsAre(nullptr));
  EXPECT_THAT(second.reasons, ElementsAre("no_prior_depth"));
}

TEST(Companions, ASourceImageMayBeAsFarAsItsTolerance) {
  InputMatcherOptions options;
  options.source_cameras = 2;
  Matching m(options);
  for (const size_t camera : {0, 1}) m.matcher.set_companion_expected(kSourceStream + camera, true);
  m.Posed(0);
  const Picture near = m.Companion(kSourceStream, 4 * kMs);  // ~source_tolerance is 5 ms
  m.Companion(kSourceStream + 1, -10 * kMs);
  EXPECT_THAT(m.Take(10).stamps, IsEmpty());
  const Taken taken = m.Take(10.5);
  EXPECT_EQ(taken.matches.at(0).companions.at(kSourceStream), near);
  EXPECT_THAT(taken.reasons, ElementsAre("no_source_image"));
  EXPECT_THAT(taken.message, HasAll("source camera 2", "within 5 ms"));
}

TEST(Companions, TellsOfASecondOneOfOneStampAndUsesTheFirst) {
  Matching m;
  const Picture first = m.Companion(kMaskStream, 0);
  m.Companion(kMaskStream, 0);  // of another mapper's network
  m.Companion(kLabelStream, 0);
  m.Posed(0);
  const Taken taken = m.Take();
  EXPECT_THAT(taken.reasons, ElementsAre("duplicate_companion"));
  EXPECT_EQ(taken.matches.at(0).companions.at(kMaskStream), first);
}

TEST(Companions, ThoseOfTheRunBeforeAreForgotten) {
  MaskedMatching m;
  for (const int64_t stamp : {int64_t{0}, kS}) {
    m.Companion(kMaskStream, stamp);
    m.Posed(stamp);
  }
  EXPECT_EQ(m.Take().masks.size(), 2u);
  m.Posed(0);
  EXPECT_THAT(m.Take(1).stamps, IsEmpty()) << "the old mask of this stamp is not its own";
  const Picture mask = m.Companion(kMaskStream, 0);
  EXPECT_THAT(m.Take(1.1).masks, ElementsAre(mask));
}

/// Two runs of the same 2 s recording in each order of image, pose and cloud; W: all poses and clouds of a run come
/// before its first image.
TEST(ALoopingBag, LosesAndMixesNothing) {
  for (const std::string order : {"icp", "ipc", "cip", "cpi", "pic", "pci", "W"}) {
    const int images = order == "W" ? 5 : 20;
    Matching m;
    m.matcher.set_clouds_expected(true);
    std::vector<int64_t> stamps;
    std::vector<double> poses, clouds;
    size_t jumps = 0;
    const auto take = [&] {
      const Taken taken = m.Take();
      for (size_t i = 0; i < taken.stamps.size(); ++i) {
        stamps.push_back(taken.stamps[i]);
        poses.push_back(taken.poses[i]);
        clouds.push_back(taken.clouds[i]);
        EXPECT_EQ(taken.matches[i].cloud->stamp_ns, taken.matches[i].image.stamp_ns) << order;
      }
      jumps += taken.jumps;
      EXPECT_THAT(taken.reasons, IsEmpty());
    };
    std::vector<int64_t> expected_stamps;
    std::vector<double> runs;
    for (const double run : {0.0, 1.0}) {
      for (int i = 0; i < images && order == "W"; ++i) m.Pose(i * 100 * kMs, run);
      for (int i = 0; i < images && order == "W"; ++i) m.Cloud(i * 100 * kMs, run);
      for (int i = 0; i < images; ++i) {
        const int64_t stamp = i * 100 * kMs;
        expected_stamps.push_back(stamp);
        runs.push_back(run);
        for (const char stream : order) {
          if (stream == 'i' || stream == 'W') m.Image(stamp);
          if (stream == 'p') m.Pose(stamp, run);
          if (stream == 'c') m.Cloud(stamp, run);
          take();
        }
      }
    }
    EXPECT_EQ(stamps, expected_stamps) << order;
    EXPECT_EQ(poses, runs) << order;
    EXPECT_EQ(clouds, runs) << order;
    EXPECT_EQ(jumps, 1u) << order;
  }
}

TEST(ALoopingBag, KeepsWhatCameBeforeTheLastImageOfTheOldRun) {
  Matching m;
  m.matcher.set_clouds_expected(true);
  m.Pose(0, 7);  // of the old run, for no image
  for (const double run : {0.0, 1.0}) {
    m.Pose(run == 0 ? 5 * kS : 0, run);
    m.Cloud(run == 0 ? 5 * kS : 0, run);
  }
  m.Image(5 * kS);  // the greatest message, and the slowest
  m.Image(0);
  const Taken taken = m.Take();
  EXPECT_THAT(taken.poses, ElementsAre(0, 1));
  EXPECT_THAT(taken.clouds, ElementsAre(0, 1));
}

TEST(ALoopingBag, TakesNoCloudOfAShorterRunBefore) {
  Matching m;
  std::optional<std::pair<int64_t, double>>
      late;  // each comes after the next image, the last one after the next run's first
  for (const auto& [run, seconds] : {std::pair(0, 10), {1, 5}, {2, 5}}) {
    for (int i = 0; i < seconds; ++i) {
      m.Pose(i * kS, run);
      m.Image(i * kS);
      const Taken taken = m.Take();
      ASSERT_EQ(taken.stamps.size(), 1u);
      if (i == 0) {
        EXPECT_THAT(taken.clouds, ElementsAre(-1)) << "none of run " << run << " has come";
      }
      if (late) m.Cloud(late->first, late->second);
      late = {i * kS, run};
    }
  }
}

TEST(ALoopingBag, TakesNothingOfTheOldRunThatCameAfterTheJump) {
  Matching m;
  m.matcher.set_clouds_expected(true);
  constexpr int64_t kLast = 5 * kS;
  for (const int64_t stamp : {int64_t{0}, kLast - 100 * kMs}) {
    m.Cloud(stamp, 0);
    m.Posed(stamp, 0);
  }
  ASSERT_EQ(m.Take().stamps.size(), 2u);
  m.Image(kLast);
  m.Image(0);
  m.Cloud(kLast, 0);  // late
  m.Pose(kLast, 0);
  m.Pose(0, 1);
  EXPECT_THAT(m.Take(1).stamps, IsEmpty()) << "its own cloud may still come";
  m.Cloud(0, 1);
  const Taken taken = m.Take(1);
  EXPECT_THAT(taken.poses, ElementsAre(1));
  EXPECT_THAT(taken.clouds, ElementsAre(1));
  m.Cloud(kLast, 1);
  m.Posed(kLast, 1);
  EXPECT_THAT(m.Take(1).poses, ElementsAre(1)) << "the late one has this stamp, too";
}

TEST(ALoopingBag, ForgetsTheOldRunAtAJump) {
  Matching m;
  m.Cloud(5 * kS);
  m.Pose(0);  // old run: must not match an image of the new one
  m.Image(5 * kS);
  m.Image(0);
  const Taken jump = m.Take();
  EXPECT_THAT(jump.stamps, IsEmpty());
  EXPECT_THAT(jump.reasons, ElementsAre("no_pose")) << "it has waited for one in vain";
  m.Pose(0);
  EXPECT_THAT(m.Take().clouds, ElementsAre(-1));
}

TEST(ALoopingBag, APoseThatIsSentAgainIsNoNewRun) {
  Matching m;
  for (const int64_t stamp : {10 * kS, 3 * kS, 11 * kS}) m.Pose(stamp);
  m.Image(11 * kS);
  m.Image(0);
  m.Pose(4 * kS, 1);
  m.Image(3 * kS);
  EXPECT_THAT(m.Take().stamps, ElementsAre(11 * kS)) << "all poses but one are of the run before";
}

/// Poses of a propagator at 1 kHz come before images that take three seconds to arrive.
TEST(InputMatcher, LateImagesFindTheirPosesAmongThoseOfAFastSource) {
  constexpr int64_t kMs = 1000000;
  Matching matching;
  matching.Image(0);
  EXPECT_TRUE(matching.Take().stamps.empty());
  for (int i = 0; i <= 3000; ++i) matching.Pose(i * kMs + 10000, i);
  matching.Image(100 * kMs);
  const Taken taken = matching.Take();
  EXPECT_EQ(taken.stamps, (std::vector<int64_t>{0, 100 * kMs}));
  EXPECT_EQ(taken.poses, (std::vector<double>{0, 100}));
}

}  // namespace
}  // namespace acmp
