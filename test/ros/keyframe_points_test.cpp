#include "acmp_mapping/ros/keyframe_points.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/ros/output_conversion.h"
#include "support/error_text.h"

namespace acmp {
namespace {

KeyframeOutput MakeOutput() {
  auto frame = std::make_shared<ReceivedFrame>();
  frame->id = 42;
  frame->camera = {64, 48, 50.1, 50.2, 31.3, 23.4};
  CaptureOrigin origin;
  origin.stamp_ns = 1403636579763555584;
  origin.camera_frame = "cam";
  origin.world_frame = "world";
  origin.world_from_cam.translation() << 1.0 / 3, 2e5, -3;
  origin.world_from_cam.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));
  origin.path.child_from_cam->translation() << 0.1, 0.2, 0.3;
  origin.path.maps_world_to_child = true;
  origin.path.tolerance_ns = 2500000;
  origin.path_frame = "global";
  origin.run = 1700000000123456789;
  origin.id = 42;
  frame->origin = std::make_shared<const CaptureOrigin>(origin);
  frame->jpeg = std::make_shared<const std::string>("a picture");
  auto maps = std::make_shared<KeyframeDepth>();
  maps->frame = std::move(frame);
  return {
      maps, {}, PointCloud{{{1, 2, 3}, {0, 0, -1}, {4, 5, 6}, 0, 0.5f}, {{7, 8, 9}, {0, 0, -1}, {1, 1, 1}, 0, 0.25f}}};
}

TEST(KeyframePoints, SayWhereARefinedPoseLies) {
  KeyframeOutput output = MakeOutput();
  EXPECT_FALSE(ReadHead(*ToKeyframePoints(output, "m", false)).pose.refined);
  auto maps = std::make_shared<KeyframeDepth>();
  maps->frame = output.maps->frame;
  maps->cam_from_world.translation() << 7, 8, 9;
  maps->refined_camera = RefinedCamera{3, output.origin().world_from_cam.inverse(), 0.25};
  output.maps = maps;
  const KeyframePose pose = ReadHead(*ToKeyframePoints(output, "m", false)).pose;
  ASSERT_TRUE(pose.refined);
  EXPECT_EQ(pose.world_from_capture.matrix(), maps->cam_from_world.inverse().matrix()) << "bit by bit";
  EXPECT_EQ(pose.refined->refined.world, 3u);
  EXPECT_EQ(pose.refined->refined.world_from_cam.matrix(), output.origin().world_from_cam.inverse().matrix());
  EXPECT_EQ(pose.refined->refined.scale, 0.25);
  EXPECT_EQ(pose.refined->received.matrix(), output.origin().world_from_cam.matrix());
}

TEST(KeyframePoints, OfAFaceHaveThePoseOfItsCapture) {
  const KeyframeOutput front = MakeOutput();
  auto frame = std::make_shared<ReceivedFrame>();
  frame->id = 44;
  frame->camera = front.frame().camera;
  frame->origin = front.frame().origin;
  frame->face = {"left", frame->camera, Eigen::AngleAxisd(-1.5, Eigen::Vector3d::UnitY()).toRotationMatrix()};
  const RigidTransform cam_from_capture(frame->face.lens_from_face.transpose());
  auto maps = std::make_shared<KeyframeDepth>();
  RigidTransform placed = RigidTransform::Identity();
  placed.translation() << 7, 8, 9;
  maps->cam_from_world = cam_from_capture * placed;
  maps->refined_camera = RefinedCamera{3, (cam_from_capture * front.origin().world_from_cam).inverse(), 0.25};
  maps->frame = frame;
  const KeyframePointsHead head = ReadHead(*ToKeyframePoints({maps, {}, PointCloud()}, "m", false));
  EXPECT_EQ(head.key.id - head.pose.view, 42u) << "the front's id";
  EXPECT_EQ(head.pose.camera_frame, "cam_left");
  EXPECT_TRUE(head.pose.world_from_capture.isApprox(placed.inverse(), 1e-9));
  EXPECT_TRUE(head.pose.world_from_cam().isApprox(maps->cam_from_world.inverse(), 1e-9));
  ASSERT_TRUE(head.pose.refined);
  EXPECT_TRUE(head.pose.refined->refined.world_from_cam.isApprox(front.origin().world_from_cam.inverse(), 1e-9));
  EXPECT_EQ(head.pose.refined->received.matrix(), front.origin().world_from_cam.matrix());
  EXPECT_TRUE(head.pose.path.child_from_cam->isApprox(*front.origin().path.child_from_cam));
}

TEST(KeyframePoints, BringTheImageOnce) {
  EXPECT_EQ(ToKeyframePoints(MakeOutput(), "m", false)->image.data.size(), 9u);
  EXPECT_TRUE(ToKeyframePoints(MakeOutput(), "m", true)->image.data.empty()) << "better points";
}

TEST(KeyframePoints, BadOnesAreRefused) {
  const auto message = ToKeyframePoints(MakeOutput(), "m", false);
  const auto refusal = [&](const std::function<void(acmp_mapping::KeyframePoints*)>& change) {
    acmp_mapping::KeyframePoints bad = *message;
    change(&bad);
    return ErrorOf([&] { ReadHead(bad); });
  };
  EXPECT_THAT(refusal([](auto* m) { m->mapper.clear(); }), HasSubstr("mapper is empty"));
  EXPECT_THAT(refusal([](auto* m) { m->mapper = std::string(300, 'm'); }), HasSubstr("a name of 300 characters"));
  EXPECT_THAT(refusal([](auto* m) { m->mapper = "m\n[FATAL]: forged"; }), HasSubstr("must be the name of a node"));
  EXPECT_THAT(refusal([](auto* m) { m->path_T_child_capture[0] = 5; }), HasSubstr("path_T_child_capture"));
  EXPECT_THAT(refusal([](auto* m) { m->path_tolerance = std::numeric_limits<double>::quiet_NaN(); }),
              HasSubstr("path_tolerance"));
  EXPECT_THAT(refusal([](auto* m) { m->refined_world = 1; }), HasSubstr("refined_scale"));
  EXPECT_THAT(refusal([](auto* m) { m->refined_world = 1, m->refined_scale = 1; }), HasSubstr("T_refined_capture"));
}

TEST(OptimizedPath, WarnsWhenNoStampFits) {
  OptimizedPath path;
  path.poses.resize(4);
  ReposeResult result;
  EXPECT_TRUE(DescribeDoubt(path, result, "world").message.empty()) << "there are no keyframes yet";
  result.nearest = ReposeResult::Gap{33400000, 1000000};
  EXPECT_THAT(DescribeDoubt(path, result, "world").message, HasAll("none of the 4", "within 1 ms", "33.4 ms away"));
  result.named = 1;
  EXPECT_TRUE(DescribeDoubt(path, result, "world").message.empty());
}

TEST(OptimizedPath, NamesWhatIsTooFarAway) {
  ReposeResult result;
  EXPECT_TRUE(DescribeTooFar(result).message.empty());
  result.nearest = ReposeResult::Gap{0, 1000000};
  result.too_far = 2;
  result.first_too_far = ReposeResult::TooFar{1500000000, {1e12, 0, -3}, {{0, 5, 0}, 1e8}};
  const RejectedInput too_far = DescribeTooFar(result);
  EXPECT_EQ(too_far.reason, "optimized_path_too_far");
  EXPECT_THAT(too_far.message, HasAll("keyframes not moved by optimized_path: 2;", "pose 1.500000000 to (1e+12, 0, -3)",
                                      "within 1e+08 of (0, 5, 0)"));
  EXPECT_TRUE(DescribeDoubt(OptimizedPath(), result, "world").message.empty()) << "the stamps fit";
}

}  // namespace
}  // namespace acmp
