// The same scene in different messages: the numbers are the same, so the depth must be, bit by bit. Those of known
// frontends are in frontends_rostest.

#include <acmp_mapping/Keyframe.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud_conversion.h>
#include <tf2_eigen/tf2_eigen.h>
#include <boost/make_shared.hpp>
#include <chrono>
#include <future>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/mapper_worker.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::inputs_rostest {

constexpr size_t kViews = 5;

template <class Message>
ros::Publisher Advertise(ros::NodeHandle* nh, const std::string& topic) {
  return nh->advertise<Message>(topic, 100);
}

/// A mapper in a namespace.
struct Mapper : MapperControl {
  explicit Mapper(const std::string& of_ns, const Parameters& parameters = {})
      : MapperControl(parameters, std::nullopt, of_ns) {}

  /// All depth images of the scene, or fewer.
  std::vector<sensor_msgs::ImageConstPtr> Finish() {
    keyframe_pose.WaitForCount(kViews);
    EXPECT_TRUE(Call("flush"));
    depth.WaitForCount(kViews);
    return depth.messages();
  }
};

/// The scene, and what is made of it by plain messages.
struct PlainInputs {
  const std::vector<ViewMessages> scene = MakeSmallScene(kViews);
  std::vector<sensor_msgs::ImageConstPtr> expected;

  PlainInputs() {
    Mapper mapper("/plain");
    EXPECT_TRUE(mapper.WaitUntilReady());
    for (const ViewMessages& view : scene) mapper.player.Publish(view);
    expected = mapper.Finish();
  }
};

class InputsTest : public SessionTest<PlainInputs> {
 protected:
  static const std::vector<ViewMessages>& Scene() { return session().scene; }

  static void ExpectTheSameDepth(Mapper* mapper) {
    const std::vector<sensor_msgs::ImageConstPtr> depth = mapper->Finish();
    ASSERT_EQ(session().expected.size(), kViews);
    ASSERT_EQ(depth.size(), kViews);
    for (size_t i = 0; i < kViews; ++i) {
      EXPECT_EQ(depth[i]->header.stamp, session().expected[i]->header.stamp);
      EXPECT_TRUE(depth[i]->data == session().expected[i]->data) << "view " << i;
    }
  }
};

TEST_F(InputsTest, KeyframesInOneMessage) {
  Mapper mapper("/keyframes", {{"keyframe_mode", std::string("external")}});
  ros::Publisher publisher = Advertise<acmp_mapping::Keyframe>(&mapper.nh, "keyframe");
  ASSERT_TRUE(WaitForSubscriber(publisher) && mapper.WaitForOutputs());
  for (const ViewMessages& view : Scene()) {
    acmp_mapping::Keyframe keyframe;
    keyframe.header = view.pose.header;
    keyframe.image = view.image;
    keyframe.camera_info = view.camera_info;
    keyframe.pose = view.pose.pose;
    keyframe.points = view.sparse_points;
    publisher.publish(keyframe);
  }
  ExpectTheSameDepth(&mapper);
}

TEST_F(InputsTest, PoseWithCovarianceOldCloudsAndACalibrationFile) {
  Mapper mapper("/others", {{"pose_source", std::string("pose_cov")},
                            {"calibration_file", ACMP_SOURCE_DIR "/test/ros/small_camera.yaml"}});
  ros::Publisher pose = Advertise<geometry_msgs::PoseWithCovarianceStamped>(&mapper.nh, "pose_cov");
  ros::Publisher cloud = Advertise<sensor_msgs::PointCloud>(&mapper.nh, "sparse_points_v1");
  ASSERT_TRUE(WaitForSubscriber(mapper.player.image) && WaitForSubscriber(pose) && WaitForSubscriber(cloud));
  ASSERT_TRUE(mapper.WaitForOutputs());
  for (const ViewMessages& view : Scene()) {
    sensor_msgs::PointCloud old_cloud;
    ASSERT_TRUE(sensor_msgs::convertPointCloud2ToPointCloud(view.sparse_points, old_cloud));
    cloud.publish(old_cloud);
    geometry_msgs::PoseWithCovarianceStamped with_covariance;
    with_covariance.header = view.pose.header;
    with_covariance.pose.pose = view.pose.pose;
    pose.publish(with_covariance);
    mapper.player.image.publish(view.image);
  }
  ExpectTheSameDepth(&mapper);
}

TEST_F(InputsTest, ImagesWaitForTheExtrinsicAndAreMappedWhenItComes) {
  Mapper mapper("/body", {{"pose_child", std::string("body")}});
  ros::Publisher extrinsic = Advertise<nav_msgs::Odometry>(&mapper.nh, "extrinsic");
  ASSERT_TRUE(mapper.WaitUntilReady() && WaitForSubscriber(extrinsic));
  for (const ViewMessages& view : Scene()) mapper.player.Publish(view);
  EXPECT_TRUE(mapper.WaitForDiagnostic({"images wait: T_body_cam is not known"}));
  nav_msgs::Odometry identity;  // the body is the camera: the numbers stay the same
  identity.pose.pose.orientation.w = 1;
  extrinsic.publish(identity);
  ExpectTheSameDepth(&mapper);
  EXPECT_TRUE(mapper.WaitForLog({"T_body_cam is taken from topic extrinsic"})) << "the choice is logged";
}

/// A worker with a gate that begins to work when it is told to.
struct HeldWorker {
  explicit HeldWorker(OverloadPolicy overload) {
    NodeOptions options;
    options.device = Device::kCpu;
    options.overload = overload;
    options.keyframe_mode = KeyframeMode::kGate;
    MapperWorker::Hooks hooks;
    hooks.on_device = [this](const WorkerStatus&) { may_work.get_future().wait(); };
    hooks.on_setting = [](const AutoPreset&, const std::string&) {};
    worker.emplace(options, &shared, Mask(), &outputs, hooks);
  }

  /// An image of a camera that stands.
  void Push(int64_t stamp_ns) {
    KeyframeInput input;
    input.stamp_ns = stamp_ns;
    input.image = std::make_shared<const EncodedImage>(EncodedImage{boost::make_shared<sensor_msgs::Image>(), nullptr});
    CameraCalibration calibration;
    calibration.camera = {64, 48, 50, 50, 32, 24};
    input.calibration = std::make_shared<const CameraCalibration>(calibration);
    worker->Push(std::move(input));
  }

  const SharedOptions shared{RuntimeOptions{}};
  const IncidentLog incidents;
  OutputPublisher outputs{ros::NodeHandle("/held"), "held", &incidents, [](const RejectedInput&) {}};
  std::promise<void> may_work;
  std::optional<MapperWorker> worker;
};

// The gate asks for the depth of the keyframes before, which are not mapped yet: the image waits, not who brings it.
TEST(MapperWorkerTest, WithBlockNobodyWaitsToQueueAnImageForTheGate) {
  HeldWorker held(OverloadPolicy::kBlock);
  std::future<void> pushed = std::async(std::launch::async, [&] {
    for (const int64_t stamp_ns : {1, 2, 3}) held.Push(stamp_ns);
  });
  EXPECT_EQ(pushed.wait_for(std::chrono::seconds(30)), std::future_status::ready);
  EXPECT_EQ(held.worker->queued(), 3u);
  held.worker->Stop();
  held.may_work.set_value();
}

// What comes after a jump of the time is of another run, and has nothing to do with the keyframes before.
TEST(MapperWorkerTest, TheGateBeginsAgainAfterATimeJump) {
  for (const OverloadPolicy overload : {OverloadPolicy::kDrop, OverloadPolicy::kBlock}) {
    HeldWorker held(overload);
    for (const int64_t stamp_ns : {11, 12}) held.Push(stamp_ns);
    held.worker->StartOver();
    for (const int64_t stamp_ns : {1, 2}) held.Push(stamp_ns);
    held.may_work.set_value();
    EXPECT_EQ(held.worker->Flush(), "");
    EXPECT_EQ(held.outputs.passed_over(), 2u) << "one of each run";
  }
}

// A camera that hardly moves from each view to the next image: until matches have told the depth all are keyframes.
TEST_F(InputsTest, WithoutPointsTheGateKnowsTheDepthByMatches) {
  constexpr size_t kGateViews = 8;
  Mapper mapper("/gate", {{"keyframe_mode", std::string("gate")}});
  const ScenePlayer& player = mapper.player;
  ASSERT_TRUE(WaitForSubscriber(player.image) && WaitForSubscriber(player.pose) &&
              WaitForSubscriber(player.camera_info));
  for (ViewMessages view : MakeSmallScene(kGateViews, 1000, 160)) {
    for (const double later_s : {0.0, 0.01}) {
      SetStamp(view.image.header.stamp + ros::Duration(later_s), &view);
      view.pose.pose.position.x += 1e-4;
      player.camera_info.publish(view.camera_info);
      player.pose.publish(view.pose);
      player.image.publish(view.image);
    }
  }
  std::string told;  // "... = 8 refined + 0 dropped + 4 passed over + ..."
  ASSERT_TRUE(mapper.Call("flush", &told));
  const size_t end = told.find(" passed over");
  ASSERT_NE(end, std::string::npos) << told;
  const int passed_over = std::stoi(told.substr(told.rfind(' ', end - 1)));
  EXPECT_GE(passed_over, 3) << told;
  EXPECT_LE(passed_over, static_cast<int>(kGateViews)) << told;
}

// Rounded points give another depth range, which matching begins with: not the same bits, but the same depth.
TEST_F(InputsTest, CompressedImagesInverseFluPosesAndPointsOfTheCameraThroughTheGate) {
  Mapper mapper("/odd", {{"image_transport", std::string("compressed")},
                         {"pose_is", std::string("T_cam_world")},
                         {"pose_child", std::string("camera_flu")},
                         {"world_frame", std::string("earth")},
                         {"sparse_frame", std::string("camera")},
                         {"keyframe_mode", std::string("gate")}});
  const ScenePlayer& player = mapper.player;
  ros::Publisher image = Advertise<sensor_msgs::CompressedImage>(&mapper.nh, "image/compressed");
  ASSERT_TRUE(WaitForSubscriber(image) && WaitForSubscriber(player.pose) && WaitForSubscriber(player.sparse_points) &&
              WaitForSubscriber(player.camera_info) && mapper.WaitForOutputs());
  RigidTransform flu_from_optical = RigidTransform::Identity();
  flu_from_optical.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  for (const ViewMessages& view : Scene()) {
    sensor_msgs::CompressedImage compressed;
    cv::Mat bgr;
    cv::cvtColor(ImageDecoder().Decode({boost::make_shared<sensor_msgs::Image>(view.image), nullptr}), bgr,
                 cv::COLOR_RGB2BGR);
    cv::imencode(".png", bgr, compressed.data);
    const RigidTransform cam_from_world = ToTransform(view.pose.pose).inverse();
    std::vector<Eigen::Vector3f> points;
    for (const Eigen::Vector3d& point : ToSparseCloud(view.sparse_points).points) {
      points.push_back((cam_from_world * point).cast<float>());
    }
    geometry_msgs::PoseStamped pose = view.pose;
    pose.pose = tf2::toMsg(flu_from_optical * cam_from_world);
    for (const double later_s : {0.0, 0.01}) {  // the gate passes over the second
      compressed.header = pose.header = view.image.header;
      compressed.header.stamp = pose.header.stamp = view.image.header.stamp + ros::Duration(later_s);
      player.camera_info.publish(view.camera_info);
      player.sparse_points.publish(MakeCloud(points, "misleading", pose.header.stamp));
      player.pose.publish(pose);
      image.publish(compressed);
    }
  }
  const std::vector<sensor_msgs::ImageConstPtr> depth = mapper.Finish();
  ASSERT_EQ(depth.size(), kViews);
  size_t near = 0, all = 0;
  for (size_t i = 0; i < kViews; ++i) {
    EXPECT_EQ(depth[i]->header.stamp, session().expected[i]->header.stamp);
    const auto* found = reinterpret_cast<const float*>(depth[i]->data.data());
    const auto* expected = reinterpret_cast<const float*>(session().expected[i]->data.data());
    for (size_t k = 0; k < depth[i]->data.size() / sizeof(float); ++k, ++all) {
      near += std::abs(found[k] - expected[k]) < 0.02f * expected[k];
    }
  }
  EXPECT_GT(static_cast<double>(near), 0.7 * static_cast<double>(all));
  EXPECT_EQ(mapper.keyframe_pose.messages().front()->header.frame_id, "earth");
}

/// It sees depth by the other camera's images alone.
TEST_F(InputsTest, ACameraThatStandsBesideAnotherOneIsMapped) {
  constexpr double kBaseline_m = 0.2;
  SyntheticSceneOptions scene = {64, 48, kViews};
  scene.standing = true;
  scene.stereo_baseline_m = kBaseline_m;
  Mapper mapper("/stereo", {{"source_cameras", 1}, {"mask_wait", 10.0}});
  ros::Publisher image = Advertise<sensor_msgs::Image>(&mapper.nh, "source_image");
  ros::Publisher info = Advertise<sensor_msgs::CameraInfo>(&mapper.nh, "source_camera_info");
  ASSERT_TRUE(WaitForSubscriber(image) && WaitForSubscriber(info) && mapper.WaitUntilReady());
  std::vector<ViewMessages> views;
  for (const SyntheticView& view : MakeSyntheticScene(scene)) {
    views.push_back(MakeMessages(view, StampOf(views.size())));
    sensor_msgs::CameraInfo right = views.back().camera_info;
    right.P[3] = -kBaseline_m * right.P[0];
    info.publish(right);
    image.publish(ToColorMessage(view.right->color, right.header));
  }
  for (const char* topic : {"image", "camera_info"}) {
    ASSERT_TRUE(mapper.WaitForDiagnostic({Concat("/stereo/source_", topic, " = ", kViews, " received")}));
  }
  EXPECT_EQ(mapper.Map(views), kViews);
  EXPECT_TRUE(mapper.WaitForLog({"source camera 1 is at (0.2", "by P of the camera_infos"}));
}

TEST_F(InputsTest, AnInvertedExtrinsicIsNamed) {
  RigidTransform body_from_cam = RigidTransform::Identity();
  body_from_cam.linear() = Eigen::AngleAxisd(1.2, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  body_from_cam.translation() = Eigen::Vector3d(0.1, 0, 0.05);
  XmlRpc::XmlRpcValue inverse;
  for (int i = 0; i < 16; ++i) inverse[i] = body_from_cam.inverse().matrix()(i / 4, i % 4);
  constexpr int kWidth = 240;  // px: enough for matches between images
  Mapper mapper("/inverted",
                {{"pose_child", std::string("body")}, {"T_body_cam", inverse}, {"max_image_size", kWidth}});
  ASSERT_TRUE(mapper.WaitUntilReady());
  std::vector<ViewMessages> views = MakeSmallScene(8, 1000, kWidth);
  for (ViewMessages& view : views) {
    view.pose.pose = tf2::toMsg(ToTransform(view.pose.pose) * body_from_cam.inverse());
  }
  ASSERT_TRUE(mapper.SendAndFlush(views));
  EXPECT_TRUE(mapper.WaitForLog({"pose_reading", "what fits is the inverse of T_body_cam"}));
}

}  // namespace acmp::test::inputs_rostest
