#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "acmp_mapping/common/error.h"
#include "pose_scene.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

class RefineImagePosesTest : public ::testing::Test {
 protected:
  void Perturb(double rotation_deg, double position) {
    PoseErrors errors(rotation_deg, position);
    for (PosedImage& image : images_) image.cam_from_world = errors.Perturbed(image.cam_from_world);
  }

  PoseRefinement Refine() { return RefineImagePoses(images_, RoomPixels, options_); }

  void ExpectUnchanged(const PoseRefinement& result) {
    EXPECT_FALSE(result.changed);
    EXPECT_FALSE(result.reason.empty());
    ASSERT_EQ(result.poses.size(), images_.size());
    for (size_t i = 0; i < images_.size(); ++i) {
      EXPECT_EQ(result.poses[i].id, images_[i].id);
      EXPECT_TRUE(SameBits(result.poses[i].cam_from_world, images_[i].cam_from_world)) << i;
    }
  }

  void ExpectRefused(const std::string& words) {
    try {
      Refine();
      FAIL() << "accepted";
    } catch (const InvalidInputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(words));
    }
  }

  PoseRefinementOptions options_;
  std::vector<PosedImage> images_ = ImagesOf(Room(), Room().size());
  const std::vector<RigidTransform> truth_ = PosesOf(images_);
};

TEST_F(RefineImagePosesTest, PosesWithErrorsComeNearTheTruth) {
  Perturb(0.3, 0.01);
  const MotionErrors before = CompareMotions(PosesOf(images_), truth_);
  const PoseRefinement result = Refine();
  EXPECT_TRUE(result.changed) << result.reason;
  const MotionErrors after = CompareMotions(PosesOf(result.poses), truth_);
  EXPECT_LT(after.rotation_deg, before.rotation_deg / 4);
  EXPECT_LT(after.position, before.position / 3);
  EXPECT_LT(result.refined_fit.median_px, result.received_fit.median_px / 3);
}

TEST_F(RefineImagePosesTest, ExactPosesStayBitByBit) {
  const PoseRefinement result = Refine();
  ExpectUnchanged(result);
  EXPECT_LT(result.received_fit.median_px, 0.3);
  EXPECT_GT(result.received_fit.matches, 500);
  EXPECT_FALSE(result.bent || result.checks.has_camera_errors);
  EXPECT_NEAR(result.checks.camera_errors->readout, 0, 0.03);
}

TEST_F(RefineImagePosesTest, OnRefinesEvenGoodPosesWithLittleHarm) {
  options_.refine = RefinePoses::kOn;
  const PoseRefinement result = Refine();
  EXPECT_TRUE(result.changed);
  const MotionErrors after = CompareMotions(PosesOf(result.poses), truth_);
  EXPECT_LT(after.rotation_deg, 0.05);
  EXPECT_LT(after.position, 0.003);
}

TEST_F(RefineImagePosesTest, BlankImagesLeavePosesAndSaySo) {
  options_.refine = RefinePoses::kOn;
  const PoseRefinement result = RefineImagePoses(
      images_,
      [&](size_t i) {
        return ImagePixels{GrayImage(images_[i].camera.width, images_[i].camera.height, 128.0f), {}};
      },
      options_);
  ExpectUnchanged(result);
  EXPECT_THAT(result.reason, HasSubstr("few matches"));
  EXPECT_EQ(result.received_fit.matches, 0);
}

TEST_F(RefineImagePosesTest, FitIsToldPerImageAndGap) {
  PoseErrors errors(1, 0.02);
  images_[6].cam_from_world = errors.Perturbed(images_[6].cam_from_world);
  const PoseRefinement result = Refine();
  EXPECT_GT(result.poses[6].received_fit.median_px, 3 * result.poses[0].received_fit.median_px);
  ASSERT_FALSE(result.poses[6].received_fit.by_gap.empty());
  EXPECT_EQ(result.poses[6].received_fit.by_gap.front().gap, 1);
}

TEST_F(RefineImagePosesTest, TheSameInputGivesTheSameBitsWithAnyNumberOfThreads) {
  Perturb(0.3, 0.01);
  const PoseRefinement first = Refine();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const PoseRefinement second = Refine();
  for (size_t i = 0; i < images_.size(); ++i) {
    EXPECT_TRUE(SameBits(first.poses[i].cam_from_world, second.poses[i].cam_from_world)) << i;
  }
}

TEST_F(RefineImagePosesTest, FarFromTheOriginNothingIsLost) {
  Perturb(0.3, 0.01);
  RigidTransform far = RigidTransform::Identity();
  far.translation() = Eigen::Vector3d(-4e5, 5e6, 200);
  for (PosedImage& image : images_) image.cam_from_world = image.cam_from_world * far;
  const PoseRefinement result = Refine();
  std::vector<RigidTransform> truth = truth_;
  for (RigidTransform& pose : truth) pose = pose * far;
  EXPECT_LT(CompareMotions(PosesOf(result.poses), truth).position, 0.003);
}

TEST_F(RefineImagePosesTest, BadInputIsRefused) {
  images_[3].sources.push_back(14);
  ExpectRefused("source view 14");
  images_[3].sources.back() = 3;
  ExpectRefused("source view 3");
  images_[3].sources.pop_back();
  images_[3].depth_range = {2, 1};
  ExpectRefused("image 3");
  images_[3].depth_range = kRoomRange;
  images_[3].cam_from_world.translation().x() = NAN;
  ExpectRefused("image 3");
}

TEST_F(RefineImagePosesTest, AnImageOfAnotherSizeIsRefused) {
  EXPECT_THROW(RefineImagePoses(
                   images_,
                   [](size_t) {
                     return ImagePixels{GrayImage(10, 10), {}};
                   },
                   options_),
               InvalidInputError);
}

}  // namespace
}  // namespace acmp
