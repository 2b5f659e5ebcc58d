#include "landmark_matching.h"

#include <gtest/gtest.h>

#include "corner_detection.h"
#include "pose_scene.h"

namespace acmp {
namespace {

class LandmarkMatchingTest : public ::testing::Test {
 protected:
  LandmarkMatchingTest() {
    for (int i = 0; i < 5; ++i) {
      const Frame& frame = Room()[static_cast<size_t>(4 + i)].frame;
      views_.push_back({frame.camera, GrayPyramid(frame.gray.View()), {}});
      cameras_.push_back(frame.camera);
      poses_.push_back(ToViewPose(frame.cam_from_world));
    }
    for (int i = 0; i < 5; ++i) posed_.push_back({i, &views_[static_cast<size_t>(i)], poses_[static_cast<size_t>(i)]});
    corners_ = PickCorners(views_[2], CornerResponse(views_[2].pyramid.level(0)), {}, CornersFor(cameras_[2], 300));
  }

  const DepthMap& TrueDepth() const { return Room()[6].true_depth; }
  double TrueDepthAt(const Eigen::Vector2d& pixel) const {
    return TrueDepth()(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
  }

  std::vector<View> views_;
  std::vector<PinholeCamera> cameras_;
  std::vector<ViewPose> poses_;
  std::vector<PosedView> posed_;
  std::vector<Eigen::Vector2d> corners_;
};

TEST_F(LandmarkMatchingTest, DepthsSearchedAndTriangulatedAreThoseOfTheScene) {
  int found = 0, right = 0;
  for (const Eigen::Vector2d& corner : corners_) {
    Landmark landmark;
    landmark.anchor = 2;
    landmark.pixel = corner;
    landmark.inverse_depth =
        SearchInverseDepth(posed_[2], corner, kRoomRange, {posed_[0], posed_[1], posed_[3], posed_[4]});
    if (!(landmark.inverse_depth > 0)) continue;
    for (int view : {0, 1, 3, 4}) {
      const Alignment alignment = FindInView(landmark, posed_[2], posed_[static_cast<size_t>(view)], {});
      if (alignment.found) landmark.sightings.push_back({view, alignment.pixel});
    }
    if (landmark.sightings.size() < 2) continue;
    Triangulate(poses_, cameras_, &landmark);
    ++found;
    const double truth = TrueDepthAt(corner);
    // At the border of an object the corner belongs to either side.
    right += std::abs(1 / landmark.inverse_depth - truth) < 0.03 * truth ? 1 : 0;
  }
  EXPECT_GT(found, 60);
  EXPECT_GT(right, 0.8 * found);
}

TEST_F(LandmarkMatchingTest, NothingToSeeGivesNoDepth) {
  EXPECT_EQ(SearchInverseDepth(posed_[2], corners_[0], kRoomRange, {}), 0);
  EXPECT_EQ(SearchInverseDepth(posed_[2], {0, 0}, kRoomRange, {posed_[1], posed_[3]}), 0);
}

TEST_F(LandmarkMatchingTest, EpipolarDistanceIsThatFromTheLine) {
  Landmark landmark;
  landmark.anchor = 2;
  landmark.pixel = {100, 80};
  const ViewPose &anchor = poses_[2], &view = poses_[4];
  const Eigen::Vector3d ray = cameras_[2].Unproject(landmark.pixel);
  const auto project = [&](double inverse_depth) {
    return cameras_[4].Project(DirectionInView(ray, inverse_depth, anchor, view));
  };
  const Eigen::Vector2d near = project(1), far = project(0.2);
  const Eigen::Vector2d along = (far - near).normalized(), across(-along.y(), along.x());
  const auto distance = [&](const Eigen::Vector2d& pixel) {
    return EpipolarDistance(landmark, cameras_[2], anchor, pixel, cameras_[4], view);
  };
  EXPECT_NEAR(distance(near), 0, 1e-9);
  EXPECT_NEAR(distance(far + 7 * along), 0, 1e-9);
  EXPECT_NEAR(distance(far + 2.5 * across), 2.5, 1e-9);
  EXPECT_NEAR(distance(near - 0.5 * across - 3 * along), 0.5, 1e-9);
}

}  // namespace
}  // namespace acmp
