#include "acmp_mapping/pose_refinement/pose_refiner.h"

#include <algorithm>

#include "matching.h"
#include "pose_scene.h"
#include "support/error_text.h"

namespace acmp {
namespace {

class PoseRefinerTest : public ::testing::Test {
 protected:
  void Perturb(double rotation_deg, double position) { received_ = Perturbed(received_, rotation_deg, position); }

  Frame FrameOf(size_t i) const { return RoomFrame(i, received_[i]); }

  /// Feeds the room. Returns what Refine gave after each keyframe.
  std::vector<PoseRefinement> Run(PoseRefiner* refiner, size_t window = 8) {
    std::vector<PoseRefinement> results;
    for (size_t i = 0; i < received_.size(); ++i) {
      if (refiner->size() == window) refiner->RemoveOldest();
      refiner->Add(FrameOf(i), kRoomRange);
      results.push_back(refiner->Refine());
    }
    return results;
  }

  std::vector<RigidTransform> Window(const std::vector<RigidTransform>& poses, const PoseRefinement& result) const {
    std::vector<RigidTransform> window;
    for (const RefinedPose& pose : result.poses) window.push_back(poses[static_cast<size_t>(pose.id)]);
    return window;
  }

  const std::vector<RigidTransform> truth_ = TruePoses();
  std::vector<RigidTransform> received_ = truth_;
  PoseRefinementOptions options_;
};

TEST_F(PoseRefinerTest, EveryFullWindowComesNearTheTruth) {
  Perturb(0.3, 0.01);
  PoseRefiner refiner(options_);
  const std::vector<PoseRefinement> results = Run(&refiner);
  for (size_t i = 7; i < results.size(); ++i) {
    const PoseRefinement& result = results[i];
    ASSERT_EQ(result.poses.size(), 8u);
    EXPECT_EQ(result.poses.back().id, static_cast<int64_t>(i));
    EXPECT_TRUE(result.changed) << result.reason;
    const std::vector<RigidTransform> truth = Window(truth_, result);
    const MotionErrors before = CompareMotions(Window(received_, result), truth);
    const MotionErrors after = CompareMotions(PosesOf(result.poses), truth);
    EXPECT_LT(after.rotation_deg, before.rotation_deg / 2) << i;
    EXPECT_LT(after.position, before.position / 2) << i;
  }
}

/// The greatest of all that were measured.
double GreatestContradiction(const std::vector<PoseRefinement>& results) {
  double greatest = 0;
  int measured = 0;
  for (const PoseRefinement& result : results) {
    measured += result.checks.contradiction.has_value();
    greatest = std::max(greatest, result.checks.contradiction.value_or(0));
  }
  EXPECT_GE(measured, 6);
  return greatest;
}

TEST_F(PoseRefinerTest, ExactPosesDoNotContradictTheImages) {
  PoseRefiner refiner(options_);
  EXPECT_LT(GreatestContradiction(Run(&refiner)), 0.002);
}

// Each pose is off by 0.1 degrees and 4 mm about and along each axis, but all of them lie where they should.
TEST_F(PoseRefinerTest, NoiseOfSinglePosesHardlyContradictsTheImages) {
  Perturb(0.1, 0.004);
  PoseRefiner refiner(options_);
  EXPECT_LT(GreatestContradiction(Run(&refiner)), 0.01);
}

TEST_F(PoseRefinerTest, AFrontendThatHasLostTrackContradictsTheImages) {
  received_ = LostFrom(0, truth_);
  PoseRefiner refiner(options_);
  const std::vector<PoseRefinement> results = Run(&refiner);
  ASSERT_TRUE(results.back().checks.contradiction);
  EXPECT_GT(*results.back().checks.contradiction, 0.02);
  EXPECT_FALSE(results[4].checks.contradiction) << "five images tell nothing";
}

/// Where the camera was between two images.
RigidTransform Between(const RigidTransform& a, const RigidTransform& b, double share) {
  const RigidTransform from = a.inverse(), to = b.inverse();
  RigidTransform pose = RigidTransform::Identity();
  pose.linear() =
      Eigen::Quaterniond(from.rotation()).slerp(share, Eigen::Quaterniond(to.rotation())).toRotationMatrix();
  pose.translation() = from.translation() + share * (to.translation() - from.translation());
  return pose.inverse();
}

// Images are 200 ms apart. In windows of 14: an offset shows where the camera turns now faster, now slower.
TEST_F(PoseRefinerTest, AnOffsetOfTheStampsIsFound) {
  for (size_t i = 0; i + 1 < truth_.size(); ++i) received_[i] = Between(truth_[i], truth_[i + 1], 0.25);
  PoseRefiner refiner(options_);
  const PoseRefinement later = Run(&refiner, 14)[12];
  ASSERT_TRUE(later.checks.stamp_offset_s);
  EXPECT_NEAR(*later.checks.stamp_offset_s, 0.05, 0.01);

  received_[0] = Between(truth_[0], truth_[1], -0.25);
  for (size_t i = 1; i < truth_.size(); ++i) received_[i] = Between(truth_[i], truth_[i - 1], 0.25);
  refiner.Reset();
  const PoseRefinement earlier = Run(&refiner, 14)[13];
  ASSERT_TRUE(earlier.checks.stamp_offset_s);
  EXPECT_NEAR(*earlier.checks.stamp_offset_s, -0.05, 0.01);
}

TEST_F(PoseRefinerTest, NoOffsetIsFoundInPosesThatAreRightOrNoisy) {
  PoseRefiner exact(options_);
  for (const PoseRefinement& result : Run(&exact, 14)) EXPECT_FALSE(result.checks.stamp_offset_s);
  Perturb(0.1, 0.004);
  PoseRefiner noisy(options_);
  for (const PoseRefinement& result : Run(&noisy, 14)) EXPECT_FALSE(result.checks.stamp_offset_s);
}

// From image 8 on the frontend's world is turned by 1 degree, moved by 3 cm and 2 % larger. Images show no such motion:
// a baseline that is none must not be believed.
TEST_F(PoseRefinerTest, ALoopClosureInTheWindowIsNotTakenForAMotion) {
  constexpr size_t kClosure = 8;
  RigidTransform correction = RigidTransform::Identity();
  correction.linear() = Eigen::AngleAxisd(M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  correction.translation() = Eigen::Vector3d(0.03, 0, 0);
  for (size_t i = kClosure; i < truth_.size(); ++i) {
    RigidTransform world_from_cam = truth_[i].inverse();
    world_from_cam.translation() *= 1.02;
    received_[i] = (correction * world_from_cam).inverse();
  }
  PoseRefiner refiner(options_);
  const PoseRefinement result = Run(&refiner, 14).back();
  ASSERT_TRUE(result.changed) << result.reason;
  const auto across = [&](const std::vector<RigidTransform>& poses) {
    return std::vector<RigidTransform>{poses[kClosure - 1], poses[kClosure]};
  };
  const MotionErrors before = CompareMotions(across(received_), across(truth_));
  const MotionErrors after = CompareMotions(across(PosesOf(result.poses)), across(truth_));
  EXPECT_LT(after.rotation_deg, before.rotation_deg / 5);
  EXPECT_LT(after.position, before.position / 5);
}

TEST_F(PoseRefinerTest, ExactPosesStayBitByBit) {
  PoseRefiner refiner(options_);
  for (const PoseRefinement& result : Run(&refiner)) {
    EXPECT_FALSE(result.changed);
    for (const RefinedPose& pose : result.poses) {
      EXPECT_TRUE(SameBits(pose.cam_from_world, truth_[static_cast<size_t>(pose.id)]));
    }
  }
}

TEST_F(PoseRefinerTest, OnlyWhatStandsByPoseAndImageIsLeftOut) {
  PoseRefiner refiner(options_);
  EXPECT_TRUE(refiner.Add(FrameOf(5), kRoomRange));
  const auto add = [&](int64_t id, size_t image, const RigidTransform& pose) {
    Frame frame = FrameOf(image);
    frame.id = id;
    frame.stamp_s = 200 + static_cast<double>(id);
    frame.cam_from_world = pose;
    return refiner.Add(frame, kRoomRange);
  };
  EXPECT_FALSE(add(6, 5, truth_[5]));
  EXPECT_EQ(refiner.size(), 1u);
  EXPECT_TRUE(add(7, 6, truth_[5])) << "the frontend has lost track";
  EXPECT_TRUE(add(8, 6, truth_[6])) << "its pose jumps";
  EXPECT_EQ(refiner.size(), 3u);
}

TEST_F(PoseRefinerTest, TheSameKeyframesGiveTheSameBits) {
  Perturb(0.3, 0.01);
  PoseRefiner a(options_), b(options_);
  Run(&b);
  b.Reset();
  EXPECT_EQ(b.size(), 0u);
  const std::vector<PoseRefinement> first = Run(&a), second = Run(&b);
  for (size_t i = 0; i < first.size(); ++i) {
    for (size_t k = 0; k < first[i].poses.size(); ++k) {
      EXPECT_TRUE(SameBits(first[i].poses[k].cam_from_world, second[i].poses[k].cam_from_world));
    }
  }
}

TEST_F(PoseRefinerTest, KeyframesThatAreFixedStayBitByBit) {
  Perturb(0.3, 0.01);
  PoseRefiner refiner(options_);
  const std::vector<PoseRefinement> results = Run(&refiner, received_.size());
  constexpr size_t kFree = 8, kMinFixed = 4;  // the newest are free, once there are as many others
  for (size_t i = kFree + kMinFixed; i < results.size(); ++i) {
    ASSERT_TRUE(results[i - 1].changed && results[i].changed);
    const std::vector<RefinedPose>&before = results[i - 1].poses, &now = results[i].poses;
    for (size_t k = 0; k < now.size() - kFree; ++k) {
      EXPECT_TRUE(SameBits(now[k].cam_from_world, before[k].cam_from_world)) << k << " after keyframe " << i;
    }
    EXPECT_FALSE(SameBits(now[now.size() - kFree].cam_from_world, before[now.size() - kFree].cam_from_world));
  }
  const std::vector<RigidTransform> truth = Window(truth_, results.back());
  const MotionErrors before = CompareMotions(received_, truth),
                     after = CompareMotions(PosesOf(results.back().poses), truth);
  EXPECT_LT(after.rotation_deg, before.rotation_deg / 2);
  EXPECT_LT(after.position, before.position / 2);
}

// Else keyframes of before and after it would be placed as one trajectory.
TEST_F(PoseRefinerTest, WhatComesAfterAResetIsInAnotherWorld) {
  Perturb(0.3, 0.01);
  PoseRefiner refiner(options_);
  const PoseRefinement before = Run(&refiner).back();
  refiner.Reset();
  EXPECT_EQ(refiner.size(), 0u);
  for (const PoseRefinement& after : Run(&refiner)) {
    EXPECT_TRUE(!after.changed || after.world > before.world);
  }
}

TEST_F(PoseRefinerTest, FewKeyframesOrMatchesLeavePosesAndSaySo) {
  PoseRefiner refiner(options_);
  EXPECT_TRUE(refiner.Refine().poses.empty());
  for (size_t i = 0; i < 4; ++i) {
    Frame frame = FrameOf(i);
    frame.gray = GrayImage(frame.camera.width, frame.camera.height, 77.0f);
    refiner.Add(frame, kRoomRange);
    const PoseRefinement result = refiner.Refine();
    EXPECT_FALSE(result.changed);
    EXPECT_FALSE(result.reason.empty());
    ASSERT_EQ(result.poses.size(), i + 1);
    EXPECT_TRUE(SameBits(result.poses[i].cam_from_world, received_[i]));
  }
}

TEST_F(PoseRefinerTest, BadKeyframesAreRefusedAndChangeNothing) {
  PoseRefiner refiner(options_);
  EXPECT_THROW(refiner.RemoveOldest(), InvalidInputError);
  refiner.Add(FrameOf(1), kRoomRange);
  EXPECT_THROW(refiner.Add(FrameOf(0), kRoomRange), InvalidInputError);  // older
  EXPECT_THROW(refiner.Add(FrameOf(2), DepthRange{0, 1}), InvalidInputError);
  Frame frame = FrameOf(2);
  frame.cam_from_world.translation().y() = INFINITY;
  EXPECT_THROW(refiner.Add(frame, kRoomRange), InvalidInputError);
  frame = FrameOf(2);
  frame.gray = GrayImage(3, 3);
  EXPECT_THROW(refiner.Add(frame, kRoomRange), InvalidInputError);
  frame = FrameOf(2);
  frame.stamp_s = 1;
  EXPECT_THROW(refiner.Add(frame, kRoomRange), InvalidInputError);
  EXPECT_EQ(refiner.size(), 1u);
}

TEST(CornerDetectionTest, CornersOfASquareAreFoundAndTakenCellsLeftOut) {
  GrayImage square(120, 100, 60.0f);
  for (int row = 30; row < 70; ++row) {
    for (int col = 40; col < 80; ++col) square(col, row) = 180;
  }
  View view;
  view.pyramid = GrayPyramid(square.View());
  constexpr int kCells = 30;  // of 20 px
  const Image<float> response = CornerResponse(view);
  const std::vector<Eigen::Vector2d> corners = PickCorners(view, response, kCells);
  ASSERT_EQ(corners.size(), 4u);
  for (const Eigen::Vector2d& corner : corners) {
    EXPECT_LT(std::abs(std::abs(corner.x() - 59.5) - 20), 3);
    EXPECT_LT(std::abs(std::abs(corner.y() - 49.5) - 20), 3);
  }
  EXPECT_EQ(PickCorners(view, response, kCells, {corners[0]}).size(), 3u);

  Mask mask(120, 100, 255);
  mask(45, 35) = 0;  // near the corner at (40, 30)
  view.mask_distance = MakeMaskDistance(mask);
  EXPECT_EQ(PickCorners(view, response, kCells).size(), 3u);
}

}  // namespace
}  // namespace acmp
