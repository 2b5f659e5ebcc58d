#include "acmp_mapping/ros/keyframe_outputs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/error_text.h"

namespace acmp {
namespace {

/// Refined maps of a 4x3 image with so many points, all of them in its middle.
KeyframeOutput Refined(size_t points, double min_depth_confidence, Mask mask) {
  auto frame = std::make_shared<ReceivedFrame>();
  frame->camera = {4, 3, 10, 10, 1.5, 1};
  frame->mask = std::move(mask);
  CaptureOrigin origin;
  origin.camera_frame = "camera";
  frame->origin = std::make_shared<const CaptureOrigin>(origin);
  auto maps = std::make_shared<KeyframeDepth>();
  maps->frame = frame;
  maps->depth = DepthMap(4, 3, 2.0f);
  maps->confidence = ConfidenceMap(4, 3, 0.5f);
  maps->cost = CostMap(4, 3, 0.5f);
  SurfacePoint point;
  point.position = {0, 0, 2};
  maps->points_in_camera.assign(points, point);
  if (points == 0) maps->no_points_reason = "reprojection (2 px) 90 %; check ~pose_is";
  return MakeKeyframeOutput(maps, min_depth_confidence);
}

TEST(KeyframeOutputTest, LeavesOutDepthOfLittleConfidenceAndWhatIsMasked) {
  EXPECT_EQ(Refined(5, 0.5, {}).keep(2, 1), 1);
  const KeyframeOutput output = Refined(5, 0.51, {});
  EXPECT_EQ(output.keep(2, 1), 0);
  EXPECT_EQ(output.points_in_camera().size(), 5u);
  EXPECT_EQ(&output.points_in_camera(), &output.maps->points_in_camera) << "without a mask they are not copied";
  EXPECT_EQ(output.origin().camera_frame, "camera");
  const KeyframeOutput masked = Refined(5, 0, Mask(4, 3, 0));
  EXPECT_EQ(masked.keep(2, 1), 0);
  EXPECT_EQ(masked.points_in_camera().size(), 0u);
}

TEST(KeyframeOutputTest, EveryPixelIsAPointOrLacksSomething) {
  KeyframeOutput output = Refined(3, 0, Mask(4, 3, 1));
  auto maps = std::const_pointer_cast<KeyframeDepth>(output.maps);
  std::const_pointer_cast<Frame>(maps->frame)->mask(0, 0) = 0;
  maps->range = {1, 8};
  maps->depth(1, 0) = 0;
  maps->depth(2, 0) = 8;
  maps->cost(3, 0) = kWorstCost;
  maps->cost(0, 1) = kUnsupportedCost;
  maps->cost(1, 1) = kUnverifiedCost;
  EXPECT_EQ(DescribePixels(output),
            "image 0.000000000: 25 % points, 42 % below min_confidence, 17 % filled in where no view confirms it, 8 % "
            "without "
            "depth, 8 % masked; 8 % at an end of the depth range, 1 to 8");
}

TEST(OutputStatusTest, NamesTheCheckThatLeavesARunWithoutPoints) {
  OutputStatus status;
  for (const size_t points : {0, 0, 5, 0, 0}) {
    status.CountPoints(Refined(points, 0, {}));
    EXPECT_EQ(status.DescribeRunWithoutPoints(), "") << "single ones are usual";
  }
  status.CountPoints(Refined(0, 0, {}));
  EXPECT_THAT(status.DescribeRunWithoutPoints(),
              HasAll("the last 3 refined keyframes", "reprojection (2 px) 90 %; check ~pose_is"));
  status.CountPoints(Refined(1, 0, {}));
  EXPECT_EQ(status.run_without_points, 0u);
  EXPECT_EQ(status.no_points_reason, "");
  status.CountPoints(Refined(5, 0, Mask(4, 3, 0)));
  EXPECT_EQ(status.no_points_reason, "all 5 are masked");
}

}  // namespace
}  // namespace acmp
