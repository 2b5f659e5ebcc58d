// Poses of a bundle adjustment that took a camera with a rolling shutter and radial distortion for a pinhole, with
// images of such a camera: rendered ones, warped by its errors.

#include <gtest/gtest.h>

#include "acmp_mapping/pose_refinement/pose_refiner.h"
#include "bundle.h"
#include "pose_scene.h"

namespace acmp {
namespace {

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
