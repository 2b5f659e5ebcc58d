#include <tbb/global_control.h>

#include "acmp_mapping/pose_refinement/pose_refiner.h"
#include "bundle.h"
#include "pose_scene.h"
#include "support/error_text.h"

namespace acmp {
namespace {

class RefineImagePosesTest : public ::testing::Test {
 protected:
  void Perturb(double rotation_deg, double position) {
    const std::vector<RigidTransform> poses = Perturbed(truth_, rotation_deg, position);
    for (size_t i = 0; i < images_.size(); ++i) images_[i].cam_from_world = poses[i];
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
  EXPECT_REFUSED(Refine(), "source view 14");
  images_[3].sources.back() = 3;
  EXPECT_REFUSED(Refine(), "source view 3");
  images_[3].sources.pop_back();
  images_[3].depth_range = {2, 1};
  EXPECT_REFUSED(Refine(), "image 3");
  images_[3].depth_range = kRoomRange;
  images_[3].cam_from_world.translation().x() = NAN;
  EXPECT_REFUSED(Refine(), "image 3");
  images_[3].cam_from_world = truth_[3];
  const auto small = [](size_t) { return ImagePixels{GrayImage(10, 10), {}}; };
  EXPECT_REFUSED(RefineImagePoses(images_, small, options_), "10 x 10");
}

// Poses of a bundle adjustment that took a camera with a rolling shutter and radial distortion for a pinhole, with
// images of such a camera: rendered ones, warped by its errors.

constexpr size_t kViews = 24;
constexpr size_t kLongWalk = 40;                   // full windows that are compared
const CameraErrors kErrors = {0.04, -0.05, 0.15};  // 1 px at the corner, 3 px from the first row to the last
const CameraErrors kStrong = {0.3, 0, 0};          // what a window of this walk needs to be bent by 1 %

/// A walk through the room.
const std::vector<SyntheticView>& Walk() {
  static const std::vector<SyntheticView> views = WalkThroughRoom(kLongWalk);
  return views;
}

class CameraErrorsTest : public ::testing::Test {
 protected:
  CameraErrorsTest() {
    for (size_t i = 0; i < kLongWalk; ++i) {
      const Frame& frame = Walk()[i].frame;
      truth_.Add(static_cast<int64_t>(i), static_cast<double>(i), frame.camera, frame.cam_from_world);
    }
    truth_.expected = truth_.received;
    motions_ = MotionsOf(truth_);
  }

  /// Where the camera sees what an ideal one sees at a pixel.
  Eigen::Vector2d Seen(size_t view, const Eigen::Vector2d& ideal, double depth) const {
    return ideal + PixelErrorsAt(truth_, motions_, view, ideal, truth_.cameras[view].Unproject(ideal), 1 / depth) *
                       ToVector(errors_);
  }

  GrayImage ImageWithErrors(size_t view) const {
    const SyntheticView& rendered = Walk()[view];
    const GrayImage& gray = rendered.frame.gray;
    GrayImage image = gray.Clone();
    for (int row = 0; row < image.height(); ++row) {
      for (int col = 0; col < image.width(); ++col) {
        const Eigen::Vector2d pixel(col, row);
        // Errors change slowly: those at the pixel are those where it comes from.
        const Eigen::Vector2d from = 2 * pixel - Seen(view, pixel, rendered.true_depth(col, row));
        const double u = std::clamp(from.x(), 0.0, gray.width() - 1.001),
                     v = std::clamp(from.y(), 0.0, gray.height() - 1.001);
        const int c = static_cast<int>(u), r = static_cast<int>(v);
        const double a = u - c, b = v - r;
        image(col, row) = static_cast<float>((1 - b) * ((1 - a) * gray(c, r) + a * gray(c + 1, r)) +
                                             b * ((1 - a) * gray(c, r + 1) + a * gray(c + 1, r + 1)));
      }
    }
    return image;
  }

  PoseRefinement RefineAll(const std::vector<RigidTransform>& received, RefinePoses refine) const {
    std::vector<PosedImage> images = ImagesOf(Walk(), kViews);
    for (size_t i = 0; i < kViews; ++i) images[i].cam_from_world = received[i];
    const auto load = [this](size_t i) { return ImagePixels{ImageWithErrors(i), {}}; };
    return RefineImagePoses(images, load, {refine});
  }

  /// Of a bundle adjustment that takes the camera for a pinhole.
  std::vector<RigidTransform> BentPoses() const {
    Bundle bundle = truth_;
    constexpr int kStep = 24, kReach = 6;
    for (int i = 0; i < static_cast<int>(kLongWalk); ++i) {
      const auto view = static_cast<size_t>(i);
      const PinholeCamera& camera = truth_.cameras[view];
      for (int row = kStep; row < camera.height - kStep; row += kStep) {
        for (int col = kStep; col < camera.width - kStep; col += kStep) {
          const double depth = Walk()[view].true_depth(col, row);
          Landmark landmark;
          landmark.anchor = i;
          landmark.pixel = Seen(view, {col, row}, depth);
          landmark.inverse_depth = 1 / depth;
          for (int j = std::max(i - kReach, 0); j <= std::min(i + kReach, static_cast<int>(kLongWalk) - 1); ++j) {
            const auto other = static_cast<size_t>(j);
            const Eigen::Vector3d y =
                DirectionInView(camera.Unproject({col, row}), 1 / depth, truth_.poses[view], truth_.poses[other]) *
                depth;
            if (j == i || !(y.z() > 0) || !camera.Contains(camera.Project(y))) continue;
            landmark.sightings.push_back({j, Seen(other, camera.Project(y), y.z())});
          }
          if (!landmark.sightings.empty()) bundle.landmarks.push_back(landmark);
        }
      }
    }
    BundleWeights weights;
    weights.camera_sigma = {1e-9, 1e-9, 1e-9};
    constexpr int kIterations = 60;
    CameraErrors none;
    EXPECT_TRUE(AdjustBundle(weights, kIterations, 0, &bundle, &none));
    std::vector<RigidTransform> poses;
    for (const ViewPose& pose : bundle.poses) poses.push_back(ToRigidTransform(pose));
    return poses;
  }

  /// What the last of all windows says.
  PoseRefinement RefineOnline(const std::vector<RigidTransform>& received) const {
    constexpr size_t kWindow = 30;
    PoseRefiner refiner{PoseRefinementOptions()};
    PoseRefinement result;
    for (size_t i = 0; i < kLongWalk; ++i) {
      const Frame& rendered = Walk()[i].frame;
      Frame frame;
      frame.id = static_cast<int64_t>(i);
      frame.camera = rendered.camera;
      frame.cam_from_world = received[i];
      frame.gray = ImageWithErrors(i);
      EXPECT_TRUE(refiner.Add(frame, kRoomRange)) << i;
      while (refiner.size() > kWindow) refiner.RemoveOldest();
      result = refiner.Refine();
    }
    return result;
  }

  CameraErrors errors_ = kErrors;
  Bundle truth_;
  std::vector<CameraMotion> motions_;
};

TEST_F(CameraErrorsTest, PosesThatAreReplacedAreThoseOfFreedImages) {
  const std::vector<RigidTransform> truth = TruePoses(Walk());
  const PoseRefinement result = RefineAll(truth, RefinePoses::kOn);
  ASSERT_TRUE(result.changed) << result.reason;
  ASSERT_TRUE(result.checks.has_camera_errors);
  EXPECT_NEAR(result.checks.camera_errors->readout, kErrors.readout, 0.03);
  // Twice what corners at 320 x 240 leave of exact poses without such errors.
  const MotionErrors errors = CompareMotions(PosesOf(result.poses), truth);
  EXPECT_LT(errors.rotation_deg, 0.1);
  EXPECT_LT(errors.position, 0.006);
  constexpr size_t kMiddle = kViews / 2;
  const Eigen::Vector3d turn = kErrors.readout * motions_[kMiddle].angular;
  EXPECT_LT((result.poses[kMiddle].readout.turn - turn).norm(), 0.2 * turn.norm());
}

TEST_F(CameraErrorsTest, RightPosesStayThoughTheCameraHasErrors) {
  const std::vector<RigidTransform> truth = TruePoses(Walk());
  const PoseRefinement result = RefineAll(truth, RefinePoses::kAuto);
  EXPECT_TRUE(result.checks.has_camera_errors);
  EXPECT_FALSE(result.changed);
  for (size_t i = 0; i < kViews; ++i) {
    EXPECT_TRUE(SameBits(result.poses[i].cam_from_world, truth[i])) << i;
    EXPECT_EQ(result.poses[i].readout, ReadoutMotion());
  }
}

TEST_F(CameraErrorsTest, ASetOfImagesTellsBentPosesAndReplacesThem) {
  errors_ = kStrong;
  const PoseRefinement result = RefineAll(BentPoses(), RefinePoses::kAuto);
  EXPECT_TRUE(result.bent);
  EXPECT_TRUE(result.changed) << result.reason;
  EXPECT_NEAR(result.checks.camera_errors->k1, kStrong.k1, 0.1 * kStrong.k1);
}

TEST_F(CameraErrorsTest, AWindowTellsBentPosesAndReplacesThem) {
  errors_ = kStrong;
  const PoseRefinement result = RefineOnline(BentPoses());
  EXPECT_TRUE(result.checks.has_camera_errors);
  EXPECT_TRUE(result.bent);
  EXPECT_TRUE(result.changed) << result.reason;
  ASSERT_TRUE(result.checks.camera_errors);
  EXPECT_NEAR(result.checks.camera_errors->k1, kStrong.k1, 0.1 * kStrong.k1);
}

TEST_F(CameraErrorsTest, AWindowLeavesRightPosesThoughTheCameraHasErrors) {
  errors_ = kStrong;
  const PoseRefinement result = RefineOnline(TruePoses(Walk()));
  EXPECT_TRUE(result.checks.has_camera_errors);
  EXPECT_FALSE(result.bent);
  EXPECT_FALSE(result.changed);
}

}  // namespace
}  // namespace acmp
