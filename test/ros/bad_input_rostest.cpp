// Each kind of bad input must be named to the user, in the log and with a count in the diagnostics, and must not keep
// the mapper from working on what follows.

#include <limits>

#include <gtest/gtest.h>
#include <tf2_eigen/tf2_eigen.h>

#include "acmp_mapping/ros/input_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::bad_input_rostest {

constexpr size_t kViews = 5;

class BadInputTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    mapper_ = new MapperControl();
    scene_ = new std::vector<ViewMessages>(MakeSmallScene(kViews));
    ready_ = mapper_->WaitUntilReady(60);
  }
  static void TearDownTestSuite() {
    delete scene_;
    delete mapper_;
  }
  void SetUp() override {
    ASSERT_TRUE(ready_);
    // A run of its own for each case: later stamps, nothing left of the case before.
    start_s_ += 100;
    ASSERT_TRUE(mapper().Call("reset"));
  }

  static MapperControl& mapper() { return *mapper_; }

  /// The scene at new stamps.
  static std::vector<ViewMessages> Scene() {
    std::vector<ViewMessages> messages = *scene_;
    for (size_t i = 0; i < messages.size(); ++i) SetStamp(StampOf(i, start_s_), &messages[i]);
    return messages;
  }

  static void SetStamp(const ros::Time& stamp, ViewMessages* messages) {
    messages->image.header.stamp = messages->camera_info.header.stamp = stamp;
    messages->pose.header.stamp = messages->sparse_points.header.stamp = stamp;
  }

  /// One view before the good ones.
  static ViewMessages View(size_t index = 0) {
    ViewMessages view = (*scene_)[index];
    SetStamp(ros::Time(start_s_ - 10, 0), &view);
    return view;
  }

  static void ExpectWorks() { EXPECT_EQ(mapper().Map(Scene()), kViews) << "the mapper must go on after bad input"; }

  static void ExpectNamed(const std::string& reason, const std::vector<std::string>& parts) {
    EXPECT_TRUE(mapper().WaitForLog(parts, kTimeoutS)) << parts[0] << " is not in the log";
    EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: " + reason}, kTimeoutS)) << reason << " is not counted";
  }

  static uint32_t start_s_;

 private:
  static MapperControl* mapper_;
  static std::vector<ViewMessages>* scene_;
  static bool ready_;
};
MapperControl* BadInputTest::mapper_ = nullptr;
std::vector<ViewMessages>* BadInputTest::scene_ = nullptr;
bool BadInputTest::ready_ = false;
uint32_t BadInputTest::start_s_ = 1000;

TEST_F(BadInputTest, Encoding) {
  ViewMessages view = View();
  view.image.encoding = "holograms";
  mapper().player.Publish(view);
  ExpectNamed("bad_image", {"holograms"});
  ExpectWorks();
}

TEST_F(BadInputTest, FocalLengthZero) {
  ViewMessages view = View();
  view.camera_info.K[0] = 0;
  mapper().player.Publish(view);
  ExpectNamed("bad_camera_info", {"/camera_info", "K[0] = 0"});
  ExpectWorks();
}

TEST_F(BadInputTest, UnknownDistortion) {
  ViewMessages view = View();
  view.camera_info.distortion_model = "fov";
  view.camera_info.D = {0.9};
  mapper().player.Publish(view);
  // The same reason as the case before: the log repeats a reason after a while only, the diagnostics at once.
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_camera_info", "\"fov\""}, kTimeoutS));
  ExpectWorks();
}

TEST_F(BadInputTest, ImageOfAnotherSizeThanCameraInfo) {
  ViewMessages view = View();
  view.camera_info.width = 65;
  mapper().player.Publish(view);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_image", "64x48", "65x48"}, kTimeoutS));
  ExpectWorks();
}

TEST_F(BadInputTest, NanPose) {
  ViewMessages view = View();
  view.pose.pose.position.y = std::numeric_limits<double>::quiet_NaN();
  mapper().player.Publish(view);
  ExpectNamed("bad_pose", {"/pose", "nan", "not finite"});
  ExpectWorks();
}

TEST_F(BadInputTest, QuaternionNotOfUnitLength) {
  ViewMessages view = View();
  view.pose.pose.orientation.w = view.pose.pose.orientation.x = 0;
  view.pose.pose.orientation.y = 0;
  view.pose.pose.orientation.z = 2;
  mapper().player.Publish(view);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_pose", "norm is 2"}, kTimeoutS));
  ExpectWorks();
}

TEST_F(BadInputTest, IdenticalPoses) {
  for (int i = 0; i < 3; ++i) {
    ViewMessages view = View();
    SetStamp(view.image.header.stamp + ros::Duration(i), &view);
    mapper().player.Publish(view);
  }
  // Publishing is asynchronous: flush until the mapper has seen all.
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kTimeoutS);
  while (!mapper().WaitForDiagnostic({"dropped: no_source_views", "3 ("}, 1) && ros::WallTime::now() < end) {
    ASSERT_TRUE(mapper().Call("flush"));
  }
  ExpectNamed("no_source_views", {"baseline"});
  ExpectWorks();
}

TEST_F(BadInputTest, EmptyCloud) {
  ViewMessages view = View();
  view.sparse_points = MakeCloud({}, kWorldFrame, view.image.header.stamp);
  mapper().player.Publish(view);
  ExpectNamed("sparse_empty", {"0 usable points", "0 not finite"});
  ExpectWorks();
}

TEST_F(BadInputTest, CloudOfNanAndZeros) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  ViewMessages view = View();
  view.sparse_points = MakeCloud({{nan, 0, 1}, {0, 0, 0}, {0, 0, 0}}, kWorldFrame, view.image.header.stamp);
  mapper().player.Publish(view);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: sparse_empty", "1 not finite", "2 exactly zero"}, kTimeoutS));
  ExpectWorks();
}

TEST_F(BadInputTest, CloudBehindTheCamera) {
  ViewMessages view = View();
  const Eigen::Vector3d center(view.pose.pose.position.x, view.pose.pose.position.y, view.pose.pose.position.z);
  const Eigen::Quaterniond rotation(view.pose.pose.orientation.w, view.pose.pose.orientation.x,
                                    view.pose.pose.orientation.y, view.pose.pose.orientation.z);
  const Eigen::Vector3d behind = center - rotation * Eigen::Vector3d(0, 0, 2);
  view.sparse_points =
      MakeCloud(std::vector<Eigen::Vector3f>(50, behind.cast<float>()), kWorldFrame, view.image.header.stamp);
  mapper().player.Publish(view);
  // An empty cloud has the same reason.
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: no_depth_range", "50 sparse points", "set depth_min and depth_max"},
                                         kTimeoutS));
  ExpectWorks();
}

TEST_F(BadInputTest, CloudInAnUnknownFrame) {
  ViewMessages view = View();
  view.sparse_points.header.frame_id = "odd_frame";
  mapper().player.Publish(view);
  ExpectNamed("sparse_frame_unknown", {"odd_frame", "~sparse_frame"});
  ExpectWorks();
}

TEST_F(BadInputTest, CloudWithoutCoordinates) {
  ViewMessages view = View();
  view.sparse_points.fields.clear();
  mapper().player.Publish(view);
  ExpectNamed("bad_sparse_points", {"/sparse_points", "no field \"x\""});
  ExpectWorks();
}

TEST_F(BadInputTest, PosesOfAnotherConvention) {
  const std::vector<ViewMessages> scene = Scene();
  for (size_t i = 0; i < 12; ++i) {
    ViewMessages view = scene[i % kViews];
    const ros::Time stamp = StampOf(i, start_s_);
    const RigidTransform world_from_cam = ToTransform(view.pose.pose);
    std::vector<Eigen::Vector3f> points;  // in the image, others each time
    for (int k = -12; k < 12; ++k) {
      points.push_back(
          (world_from_cam * Eigen::Vector3d(0.1 * k, 0.05 * k, 4 + 0.2 * static_cast<double>(i))).cast<float>());
    }
    view.sparse_points = MakeCloud(points, view.sparse_points.header.frame_id, stamp);
    view.pose.pose = tf2::toMsg(world_from_cam.inverse());
    SetStamp(stamp, &view);
    mapper().player.Publish(view);
  }
  EXPECT_TRUE(mapper().WaitForLog({"lie in front of the camera", "~pose_is: T_cam_world", "set this"}, kTimeoutS));
  EXPECT_TRUE(mapper().WaitForDiagnostic({"lie in front of the camera", "~pose_is: T_cam_world"}, kTimeoutS));
  ASSERT_TRUE(mapper().Call("reset")) << "the check begins anew";
  start_s_ += 50;
  ExpectWorks();
}

TEST_F(BadInputTest, TimeJumpsBack) {
  EXPECT_EQ(mapper().Map(Scene()), kViews);
  std::vector<ViewMessages> again = Scene();  // the same stamps, as a looping bag has them
  EXPECT_EQ(mapper().Map(again), kViews);
  EXPECT_TRUE(mapper().WaitForLog({"time jumped back"}, kTimeoutS));
}

TEST_F(BadInputTest, PosesFarFromTheImages) {
  std::vector<ViewMessages> late = Scene();
  for (ViewMessages& view : late) view.pose.header.stamp += ros::Duration(0.0334);
  for (const ViewMessages& view : late) mapper().player.Publish(view);
  // A view that matches overtakes them. Its image and its pose come after theirs, each on its own topic, so none of
  // theirs is still under way when the two meet: between topics there is no order.
  ViewMessages matching = View();
  SetStamp(late.back().image.header.stamp + ros::Duration(5), &matching);
  mapper().player.Publish(matching);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"last image without a pose", "33.4 ms away on /pose"}, kTimeoutS));
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: no_pose", "no pose within 1 ms", "33.4 ms away"}, kTimeoutS));
}

}  // namespace acmp::test::bad_input_rostest
