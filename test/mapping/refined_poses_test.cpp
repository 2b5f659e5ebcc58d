// Poses that do not fit the images are refined in the window, and what comes out lies in the frontend's world.

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "dense_mapper_fakes.h"
#include "pose_scene.h"
#include "support/error_text.h"

namespace acmp {
namespace {

std::shared_ptr<Frame> WithLandmarks(size_t i, const RigidTransform& received) {
  auto frame = std::make_shared<Frame>(RoomFrame(i, received));
  frame->landmarks_in_world = Room()[i].frame.landmarks_in_world;
  return frame;
}

struct RoomMap {
  std::vector<KeyframeDepthPtr> refined;
  std::vector<size_t> initial_estimates;  ///< how many each keyframe had
};

/// Maps the room while images are received; the harness keeps what came.
void Feed(const std::vector<RigidTransform>& received, MapperHarness* harness) {
  for (size_t i = 0; i < received.size(); ++i) harness->Add(WithLandmarks(i, received[i]));
}

DenseMapperOptions RoomOptions() {
  DenseMapperOptions options = FakeOptions(14, 2, 1);
  options.fallback_depth_range = kRoomRange;
  return options;
}

/// Errors are greater than a frontend's that has not lost track, so that few images show them.
DenseMapperOptions NoisyRoomOptions(RefinePoses refine) {
  DenseMapperOptions options = RoomOptions();
  options.poses.refine = refine;
  options.max_contradiction = 0.5;
  return options;
}

RoomMap Map(const std::vector<RigidTransform>& received, RefinePoses refine) {
  MapperHarness harness(NoisyRoomOptions(refine));
  Feed(received, &harness);
  harness.Flush();
  EXPECT_THAT(harness.problems, IsEmpty());
  EXPECT_THAT(harness.drops, IsEmpty());
  RoomMap map = {harness.refined, {}};
  for (size_t i = 0; i < received.size(); ++i) {
    map.initial_estimates.push_back(CallsOf(harness.engine, "photometric", static_cast<int64_t>(i)).size());
  }
  return map;
}

/// Without landmarks, in the room, and in a street where the camera moves by as much as near things are away.
TEST(MatchedDepthRangeTest, ImagesAndPosesAreEnough) {
  SyntheticSceneOptions street;
  street.place = SyntheticPlace::kStreet;
  street.keyframes = 10;
  const std::vector<SyntheticView> street_views = MakeSyntheticScene(street);
  for (const std::vector<SyntheticView>* views : {&Room(), &street_views}) {
    SCOPED_TRACE(views == &street_views ? "street" : "room");
    MapperHarness harness(FakeOptions(14, 2, 1));
    for (size_t i = 0; i < views->size(); ++i) {
      Frame frame = MakeWallFrame(static_cast<int64_t>(i), 0, {});
      frame.camera = (*views)[i].frame.camera;
      frame.cam_from_world = (*views)[i].frame.cam_from_world;
      frame.gray = (*views)[i].frame.gray.Clone();
      frame.color = {};
      harness.Add(std::make_shared<Frame>(std::move(frame)));
    }
    harness.Flush();
    EXPECT_THAT(harness.problems, ElementsAre(StartsWith("depth_range_by_matches: "))) << "told once";
    ASSERT_GE(harness.refined.size(), views->size() - 3) << "the first ones have nothing to be matched with";
    for (const KeyframeDepthPtr& keyframe : harness.refined) {
      const DepthMap& depth = (*views)[static_cast<size_t>(keyframe->frame->id)].true_depth;
      size_t inside = 0, all = 0;
      for (const float z : depth) {
        all += z > 0 ? 1 : 0;  // else it is sky
        inside += z >= keyframe->range.min && z <= keyframe->range.max ? 1 : 0;
      }
      EXPECT_GT(inside, 0.99 * static_cast<double>(all)) << keyframe->frame->id;
      EXPECT_LT(keyframe->range.max / keyframe->range.min, 200) << keyframe->frame->id;
    }
  }
}

TEST(RefinedPosesTest, KeyframesAreMatchedWithPosesNearerToTheTruth) {
  const std::vector<RigidTransform> truth = TruePoses();
  const std::vector<RigidTransform> received = Perturbed(truth, 0.3, 0.01);
  const std::vector<KeyframeDepthPtr> maps = Map(received, RefinePoses::kAuto).refined;
  std::vector<RigidTransform> refined, before, exact;
  for (const KeyframeDepthPtr& keyframe : maps) {
    const auto i = static_cast<size_t>(keyframe->frame->id);
    if (i < 6) continue;  // the first ones are matched before there is anything to refine by
    refined.push_back(keyframe->cam_from_world);
    before.push_back(received[i]);
    exact.push_back(truth[i]);
    EXPECT_GT(keyframe->pose_fit.matches, 0);
    EXPECT_LT(keyframe->pose_fit.median_px, 0.5);
  }
  ASSERT_GE(refined.size(), 6u);
  EXPECT_LT(CompareMotions(refined, exact).rotation_deg, CompareMotions(before, exact).rotation_deg / 2);
  EXPECT_LT(CompareMotions(refined, exact).position, CompareMotions(before, exact).position / 2);
}

/// The frontend's world grows along the way, as that of a monocular one does; here to 1.8 times of what it was.
std::vector<RigidTransform> GrowingPoses() {
  std::vector<RigidTransform> received = TruePoses();
  Eigen::Vector3d exact_before = received[0].inverse().translation(), centre = exact_before;
  PoseErrors errors(0.3, 0.005);
  for (size_t i = 0; i < received.size(); ++i) {
    const RigidTransform world_from_cam = received[i].inverse();
    const double scale = 1 + 0.06 * static_cast<double>(i);
    centre += scale * (world_from_cam.translation() - exact_before);
    exact_before = world_from_cam.translation();
    received[i].translation() = -(received[i].linear() * centre);
    received[i] = errors.Perturbed(received[i]);
  }
  return received;
}

TEST(RefinedPosesTest, DepthIsInTheFrontendsScale) {
  const std::vector<RigidTransform> received = GrowingPoses();
  const std::vector<KeyframeDepthPtr> maps = Map(received, RefinePoses::kOn).refined;
  const KeyframeDepthPtr last = maps.back();
  const auto i = static_cast<size_t>(last->frame->id);
  // The fake matches a wall at kWallDepth in the world that it is given; the window's is smaller than the frontend's.
  const float scale = last->depth(0, 0) / kRefinedDepth;
  EXPECT_GT(scale, 1.03);
  EXPECT_LT(scale, 1.3);
  const Eigen::Vector3d placed = last->cam_from_world.inverse().translation();
  const Eigen::Vector3d end = received[i].inverse().translation(), begin = received[0].inverse().translation();
  EXPECT_LT((placed - end).norm(), (end - begin).norm() / 10) << "one similarity for a window that grows";
  ASSERT_TRUE(last->refined_camera);
  EXPECT_FLOAT_EQ(static_cast<float>(last->refined_camera->scale), scale);
}

// So the map can be placed as a whole.
TEST(RefinedPosesTest, TheWorldOfRefinedPosesKeepsItsScale) {
  const std::vector<RigidTransform> received = GrowingPoses();
  const std::vector<RigidTransform> truth = TruePoses();
  const std::vector<KeyframeDepthPtr> maps = Map(received, RefinePoses::kOn).refined;
  std::map<int64_t, RefinedCamera> refined;
  for (const KeyframeDepthPtr& keyframe : maps) {
    if (keyframe->refined_camera) refined[keyframe->frame->id] = *keyframe->refined_camera;
  }
  const auto ratio = [&](int64_t a, int64_t b) {
    const auto step = [](const RigidTransform& p, const RigidTransform& q) {
      return (p.translation() - q.translation()).norm();
    };
    return step(refined.at(a).world_from_cam, refined.at(b).world_from_cam) /
           step(truth[static_cast<size_t>(a)].inverse(), truth[static_cast<size_t>(b)].inverse());
  };
  ASSERT_EQ(refined.count(6) + refined.count(9) + refined.count(10) + refined.count(13), 4u);
  EXPECT_EQ(refined[6].world, refined[13].world);
  // The frontend's world grows by a fifth from the middle of one to that of the other.
  EXPECT_NEAR(ratio(10, 13) / ratio(6, 9), 1, 0.06);
}

// They were made with the frontend's motion from the keyframe before, and others read them.
TEST(RefinedPosesTest, InitialEstimatesAreMadeAnewWhereThePoseHasMoved) {
  const std::vector<RigidTransform> received = Perturbed(TruePoses(), 0.6, 0.02);
  const std::vector<size_t> initial_estimates = Map(received, RefinePoses::kOn).initial_estimates;
  EXPECT_GE(std::count_if(initial_estimates.begin(), initial_estimates.end(), [](size_t n) { return n > 1; }), 3);
}

// Others read them. Where such a keyframe cannot be matched anew, none but itself is dropped.
TEST(RefinedPosesTest, AnInitialEstimateThatCannotBeMadeAnewDropsNoOtherKeyframe) {
  const std::vector<RigidTransform> received = Perturbed(TruePoses(), 0.6, 0.02);
  size_t failures = 0;
  for (const int64_t failing : {4, 7, 10}) {
    MapperHarness harness(NoisyRoomOptions(RefinePoses::kOn));
    int estimates = 0;
    harness.engine.before_answer = [&](const WallEngine::Call& call) {
      if (call.pass == "photometric" && call.reference == failing && ++estimates > 1)
        throw ProcessingError("no memory");
    };
    Feed(received, &harness);
    harness.Flush();
    for (const KeyframeDrop& drop : harness.drops) EXPECT_EQ(drop.frame->id, failing) << drop.message;
    EXPECT_EQ(harness.refined.size() + harness.drops.size(), received.size());
    failures += harness.problems.size();
  }
  EXPECT_GT(failures, 0u) << "or the test shows nothing";
}

// All keyframes end as withdrawn or dropped: nothing stays in a map.
TEST(RefinedPosesTest, NothingStaysOfAFrontendThatHasLostTrack) {
  MapperHarness harness(RoomOptions());
  Feed(LostFrom(0, TruePoses()), &harness);
  harness.Flush();
  EXPECT_GT(harness.mapper.pose_checks().contradiction.value_or(0), 0.02);
  std::set<int64_t> gone;
  for (const auto& [id, message] : harness.withdrawn) {
    gone.insert(id);
    EXPECT_THAT(message, HasSubstr("poses contradict the images"));
  }
  EXPECT_EQ(harness.refined.size(), harness.withdrawn.size());
  EXPECT_THAT(harness.refined_again, IsEmpty());
  for (const KeyframeDrop& drop : harness.drops) {
    EXPECT_EQ(drop.reason, "poses_contradict") << drop.message;
    gone.insert(drop.frame->id);
  }
  EXPECT_EQ(gone.size(), 14u);
}

// The contradiction is one of the last images, and those show that the camera stands. Until then nothing comes, also
// where it is a little below the limit: that must be so by half.
TEST(RefinedPosesTest, AContradictionEndsWhereTheCameraStands) {
  DenseMapperOptions options = RoomOptions();
  MapperHarness harness(options);
  const std::vector<RigidTransform> received = LostFrom(0, TruePoses());
  Feed(received, &harness);
  options.max_contradiction = 1.3 * *harness.mapper.pose_checks().contradiction;
  harness.mapper.set_options(options);
  harness.refined.clear();
  const size_t last = received.size() - 1;
  for (size_t i = 0; i < kContradictionImages; ++i) {
    EXPECT_GT(harness.mapper.pose_checks().contradiction.value_or(0), 0.02) << i;
    const std::shared_ptr<Frame> frame = WithLandmarks(last, received[last]);
    frame->id += static_cast<int64_t>(i) + 1;
    frame->stamp_s += 0.2 * static_cast<double>(i + 1);
    harness.Add(frame);
  }
  EXPECT_THAT(harness.refined, IsEmpty());
  EXPECT_THAT(harness.refined_again, IsEmpty());
  harness.Flush();
  EXPECT_EQ(harness.mapper.pose_checks().contradiction, 0.0);
}

/// Received poses with a jump of three poses, after which the frontend goes on as before.
std::vector<RigidTransform> WithADetour() {
  std::vector<RigidTransform> received = TruePoses();
  for (size_t i = 3; i < 6; ++i) received[i] = LostFrom(3, TruePoses())[i];
  return received;
}

// What was withdrawn and what was held back comes.
// Where the maps of one cannot be made then, it is tried again.
TEST(RefinedPosesTest, MapsComeWhenPosesAgreeAgain) {
  DenseMapperOptions options = RoomOptions();
  options.max_contradiction = 0.012;  // the detour is a contradiction of 0.016 at most
  const std::vector<RigidTransform> received = WithADetour();
  for (const bool fails_once : {false, true}) {
    MapperHarness harness(options);
    std::optional<int64_t> failed;
    harness.engine.before_consistency = [&](int64_t id) {
      const auto& withdrawn = harness.withdrawn;
      const auto is_it = [id](const auto& w) { return w.first == id; };
      if (!fails_once || failed || std::none_of(withdrawn.begin(), withdrawn.end(), is_it)) return;
      failed = id;
      throw ProcessingError("no memory for points");
    };
    Feed(received, &harness);
    harness.Flush();
    harness.Flush();
    EXPECT_THAT(harness.drops, IsEmpty());
    EXPECT_THAT(harness.withdrawn, Not(IsEmpty()));
    EXPECT_EQ(harness.refined.size(), 14u);
    EXPECT_EQ(failed.has_value(), fails_once);
    for (const auto& [id, message] : harness.withdrawn) {
      EXPECT_EQ(std::count(harness.refined_again.begin(), harness.refined_again.end(), id), 1) << id;
    }
  }
}

// Poses that a frontend has not lost contradict the images by up to 1.5 % of the depth, whatever the preset's fusion.
TEST(RefinedPosesTest, WhatContradictsTheImagesDoesNotDependOnThePreset) {
  DenseMapperOptions options = RoomOptions();
  options.pipeline.fusion.max_relative_depth = MakePreset("acmp").fusion.max_relative_depth;
  MapperHarness harness(options);
  double greatest = 0;
  const std::vector<RigidTransform> received = WithADetour();
  for (size_t i = 0; i < received.size(); ++i) {
    harness.Add(WithLandmarks(i, received[i]));
    greatest = std::max(greatest, harness.mapper.pose_checks().contradiction.value_or(0));
  }
  EXPECT_GT(greatest, options.pipeline.fusion.max_relative_depth) << "or the test shows nothing";
  EXPECT_LT(greatest, options.max_contradiction);
  EXPECT_THAT(harness.withdrawn, IsEmpty());
}

// Live, what was held back comes one by one where there is time, and none of it with the keyframe that ends that.
TEST(RefinedPosesTest, LiveNoKeyframeWaitsForWhatWasHeldBack) {
  DenseMapperOptions options = RoomOptions();
  options.live = true;
  options.max_contradiction = 0.012;  // the detour is a contradiction of 0.016 at most
  MapperHarness harness(options);
  const std::vector<RigidTransform> received = WithADetour();
  const auto refinements = [&] { return harness.refined.size() + harness.refined_again.size(); };
  for (size_t i = 0; i < received.size(); ++i) {
    const size_t before = refinements();
    harness.Add(WithLandmarks(i, received[i]));
    EXPECT_LE(refinements(), before + 1) << i;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));  // poses are mostly found by then
  }
  size_t before = refinements();
  while (harness.mapper.CatchUp()) {
    EXPECT_LE(refinements(), before + 1);
    before = refinements();
  }
  harness.Flush();
  EXPECT_THAT(harness.drops, IsEmpty());
  EXPECT_EQ(harness.refined.size(), received.size());
}

/// A camera that goes through the room and stands somewhere for a while.
struct Stand {
  size_t before = 0;  ///< images before it stands, at the last of them
  size_t standing = 0;
  size_t after = 0;
  double jitter = 0;  ///< of received positions while it stands, along each axis, scene units
};

/// Images while it stands differ by noise of three grey values, and poses by jitter. It goes back and forth through the
/// room.
void Feed(const Stand& stand, MapperHarness* harness) {
  const std::vector<RigidTransform> truth = TruePoses();
  const auto on_the_way = [turns = 2 * (truth.size() - 1)](size_t k) { return std::min(k % turns, turns - k % turns); };
  std::vector<size_t> images;
  for (size_t k = 0; k < stand.before; ++k) images.push_back(on_the_way(k));
  images.insert(images.end(), stand.standing, images.back());
  for (size_t k = 0; k < stand.after; ++k) images.push_back(on_the_way(stand.before + k));
  PoseErrors errors(0, stand.jitter);
  std::minstd_rand random(5);
  for (size_t k = 0; k < images.size(); ++k) {
    const size_t i = images[k];
    const bool is_standing = k >= stand.before && k < stand.before + stand.standing;
    const std::shared_ptr<Frame> frame = WithLandmarks(i, is_standing ? errors.Perturbed(truth[i]) : truth[i]);
    frame->id = static_cast<int64_t>(k);
    frame->stamp_s = 100 + 0.2 * static_cast<double>(k);
    for (float& value : frame->gray) value = std::clamp(value + static_cast<float>(random() % 7) - 3, 0.0f, 255.0f);
    harness->Add(frame);
  }
  harness->Flush();
}

class StandingCameraTest : public ::testing::TestWithParam<Stand> {};

TEST_P(StandingCameraTest, NothingIsWithdrawnOrHeldBack) {
  DenseMapperOptions options = RoomOptions();
  MapperHarness harness(options);
  Feed(GetParam(), &harness);
  EXPECT_LT(harness.mapper.pose_checks().contradiction.value_or(0), 0.01);
  EXPECT_THAT(harness.withdrawn, IsEmpty());
  EXPECT_THAT(harness.problems, IsEmpty());
  for (const KeyframeDrop& drop : harness.drops) EXPECT_NE(drop.reason, "poses_contradict") << drop.message;
  const Stand& stand = GetParam();
  const auto first_after = static_cast<int64_t>(stand.before + stand.standing);
  size_t after = 0;
  // Refined poses are placed along received ones, which are off by the jitter along each axis while it stood: one
  // keyframe after it may be by twice that. Ten seeds of the noise: 0.010 to 0.081 where the jitter is 0.03.
  const double most = 0.02 + 2 * std::sqrt(3) * stand.jitter;
  for (const KeyframeDepthPtr& maps : harness.refined) {
    EXPECT_NEAR(maps->depth(0, 0) / kRefinedDepth, 1, 0.25) << "scale of keyframe " << maps->frame->id;
    if (maps->frame->id < first_after) continue;
    ++after;
    const Eigen::Vector3d place = maps->cam_from_world.inverse().translation();
    EXPECT_LT((place - maps->frame->cam_from_world.inverse().translation()).norm(), most) << maps->frame->id;
  }
  EXPECT_EQ(after, stand.after);
}

INSTANTIATE_TEST_SUITE_P(ForLong, StandingCameraTest,
                         ::testing::Values(Stand{1, 59, 13, 0.0005}, Stand{1, 59, 13, 0.008}, Stand{14, 60, 0, 0},
                                           Stand{40, 60, 13, 0}, Stand{40, 60, 13, 0.03}, Stand{1, 80, 0, 0.008}));

TEST(RefinedPosesTest, PosesThatFitStayBitByBit) {
  const RoomMap map = Map(TruePoses(), RefinePoses::kAuto);
  EXPECT_THAT(map.initial_estimates, Each(1));
  for (const KeyframeDepthPtr& keyframe : map.refined) {
    EXPECT_TRUE(SameBits(keyframe->cam_from_world, keyframe->frame->cam_from_world));
    EXPECT_EQ(keyframe->depth(0, 0), kRefinedDepth);
    EXPECT_FALSE(keyframe->refined_camera);
  }
}

}  // namespace
}  // namespace acmp
