// Whether maps still fit poses that have been refined since.

#include "estimate_gain.h"

#include <memory>

#include "gtest/gtest.h"

#include "dense_mapper_fakes.h"

namespace acmp {
namespace {

using KeyframePtr = std::shared_ptr<WindowKeyframe>;

/// The wall seen by a camera of 200 px focal length at x.
KeyframePtr MakeKeyframe(int64_t id, double x) {
  Frame frame = MakeWallFrame(id, x);
  frame.camera = {240, 180, 200, 200, 119.5, 89.5};
  auto keyframe = std::make_shared<WindowKeyframe>();
  keyframe->frame = std::make_shared<Frame>(std::move(frame));
  keyframe->range = {kWallDepth, kWallDepth * 1.0001f};
  return keyframe;
}

MatchedView Matched(const KeyframePtr& source, const WindowKeyframe& reference) {
  return {source, source->cam_from_world() * reference.cam_from_world().inverse()};
}

/// To the side by what moves a point of the wall by so many px.
RigidTransform MovedBy(double pixels, const WindowKeyframe& keyframe) {
  RigidTransform pose = keyframe.frame->cam_from_world;
  pose.translation().x() += pixels * kWallDepth / keyframe.frame->camera.fx;
  return pose;
}

class PoseShiftTest : public ::testing::Test {
 protected:
  KeyframePtr reference_ = MakeKeyframe(0, 0), left_ = MakeKeyframe(1, -0.3), right_ = MakeKeyframe(2, 0.3);
  std::vector<MatchedView> views_ = {Matched(left_, *reference_), Matched(right_, *reference_)};
};

TEST_F(PoseShiftTest, PointsOutsideOfTheViewDoNotCount) {
  // Turned by 60 degrees it sees nothing of the wall's middle, where a pixel is small: 0.1 degrees would be many.
  right_->pose.refined = Eigen::AngleAxisd(1.05, Eigen::Vector3d::UnitY()) * MovedBy(0, *right_);
  views_ = {Matched(left_, *reference_), Matched(right_, *reference_)};
  right_->pose.refined = Eigen::AngleAxisd(0.002, Eigen::Vector3d::UnitY()) * *right_->pose.refined;
  EXPECT_FALSE(HaveMoved(*reference_, views_));
}

TEST_F(PoseShiftTest, DepthIsMeasuredInTheWorldOfRefinedPoses) {
  // In a world of half the size, the same moves are seen twice as large.
  reference_->pose.placed.scale = 2;
  right_->pose.refined = MovedBy(1.1, *right_);
  EXPECT_TRUE(HaveMoved(*reference_, views_));
}

}  // namespace
}  // namespace acmp
