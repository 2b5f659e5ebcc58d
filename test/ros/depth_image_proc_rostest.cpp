// launch/consumers/depth_image_proc.launch: the clouds that depth_image_proc makes of the mapper's topics, unchanged,
// are the back-projected depth maps in the colours of the image.

#include <cmath>
#include <map>

#include <gtest/gtest.h>
#include <nodelet/nodelet.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_srvs/Trigger.h>
#include <pluginlib/class_loader.hpp>

#include "ros/mapper_control.h"
#include "ros/recorder.h"

namespace acmp::test::depth_image_proc_rostest {

constexpr size_t kViews = 4;
constexpr char kNodelet[] = "depth_image_proc/point_cloud_xyzrgb";

bool NodeletExists() {
  pluginlib::ClassLoader<nodelet::Nodelet> nodelets("nodelet", "nodelet::Nodelet");
  return nodelets.isClassAvailable(kNodelet);
}

/// Number of known pixels.
size_t CompareCloud(const sensor_msgs::PointCloud2& cloud, const sensor_msgs::Image& depth,
                    const sensor_msgs::Image& color, const sensor_msgs::CameraInfo& info) {
  EXPECT_EQ(cloud.header.frame_id, depth.header.frame_id);
  EXPECT_EQ(cloud.width, depth.width);
  EXPECT_EQ(cloud.height, depth.height);
  if (cloud.width != depth.width || cloud.height != depth.height) return 0;
  const auto* depths = reinterpret_cast<const float*>(depth.data.data());
  sensor_msgs::PointCloud2ConstIterator<float> point(cloud, "x");
  sensor_msgs::PointCloud2ConstIterator<uint8_t> bgr(cloud, "rgb");
  size_t known = 0, wrong_points = 0, wrong_colors = 0;
  for (size_t i = 0; i < size_t{depth.width} * depth.height; ++i, ++point, ++bgr) {
    const double z = depths[i];
    if (std::isnan(z)) {
      wrong_points += !std::isnan(point[2]);
      continue;
    }
    ++known;
    const size_t row = i / depth.width, col = i % depth.width;
    const double x = (static_cast<double>(col) - info.P[2]) * z / info.P[0];
    const double y = (static_cast<double>(row) - info.P[6]) * z / info.P[5];
    // It computes with float numbers: some roundings of 6e-8 each.
    const double tolerance = 1e-6 * z;
    wrong_points +=
        !(std::abs(point[0] - x) <= tolerance && std::abs(point[1] - y) <= tolerance && point[2] == depths[i]);
    for (size_t c = 0; c < 3; ++c) wrong_colors += bgr[2 - static_cast<int>(c)] != color.data[3 * i + c];
  }
  EXPECT_EQ(wrong_points, 0u);
  EXPECT_EQ(wrong_colors, 0u);
  return known;
}

template <class Message>
typename Message::ConstPtr Find(Recorder<Message>* recorder, const ros::Time& stamp) {
  for (const auto& message : recorder->messages()) {
    if (message->header.stamp == stamp) return message;
  }
  return {};
}

TEST(DepthImageProcTest, CloudIsTheBackProjectedDepth) {
  if (!NodeletExists()) {
    GTEST_SKIP() << "there is no nodelet " << kNodelet << ": Debian package libdepth-image-proc-dev";
  }
  ros::NodeHandle nh;
  ros::AsyncSpinner spinner(1);
  const ScenePlayer player(nh);
  Recorder<sensor_msgs::PointCloud2> clouds(nh, "/acmp/depth_points");
  Recorder<sensor_msgs::Image> depth(nh, "/acmp/depth/image_rect");
  Recorder<sensor_msgs::Image> color(nh, "/acmp/rgb/image_rect_color");
  Recorder<sensor_msgs::CameraInfo> info(nh, "/acmp/rgb/camera_info");
  Recorder<geometry_msgs::PoseStamped> pose(nh, "/acmp/keyframe_pose");
  spinner.start();
  ASSERT_TRUE(player.WaitForMapper(kTimeoutS));
  ASSERT_TRUE(clouds.WaitForPublisher(kTimeoutS) && depth.WaitForPublisher(kTimeoutS) &&
              color.WaitForPublisher(kTimeoutS) && info.WaitForPublisher(kTimeoutS) &&
              pose.WaitForPublisher(kTimeoutS));
  // It subscribes once somebody wants its clouds; what the mapper sends before is lost. So play until one comes.
  bool connected = false;
  for (uint32_t run = 0; !connected && run < 20; ++run) {
    const std::vector<ViewMessages> messages = MakeSmallScene(kViews, 1000 + 100 * run);
    for (const ViewMessages& view : messages) player.Publish(view);
    ASSERT_TRUE(pose.WaitForCount((run + 1) * kViews, kTimeoutS));
    std_srvs::Trigger flush;
    ASSERT_TRUE(ros::service::call("/acmp/dense_mapper/flush", flush) && flush.response.success);
    ASSERT_TRUE(depth.WaitForCount((run + 1) * kViews, kTimeoutS));
    connected = clouds.WaitForCount(kViews, 2);
  }
  ASSERT_TRUE(connected) << "no clouds";

  size_t known = 0;
  for (const auto& cloud : clouds.messages()) {
    const ros::Time& stamp = cloud->header.stamp;
    const sensor_msgs::ImageConstPtr depth_map = Find(&depth, stamp), image = Find(&color, stamp);
    const sensor_msgs::CameraInfoConstPtr camera = Find(&info, stamp);
    ASSERT_TRUE(depth_map && image && camera) << "no keyframe has the stamp " << stamp;
    known += CompareCloud(*cloud, *depth_map, *image, *camera);
  }
  EXPECT_GT(known, clouds.messages().size() * 64 * 48 / 2) << "there must be something to compare";
}

}  // namespace acmp::test::depth_image_proc_rostest
