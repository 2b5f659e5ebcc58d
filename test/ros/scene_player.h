#pragma once

#include <map>
#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp::test {

constexpr char kCameraFrame[] = "test_camera";
constexpr char kWorldFrame[] = "test_world";

/// What a SLAM frontend would send for one view.
struct ViewMessages {
  sensor_msgs::Image image;
  sensor_msgs::CameraInfo camera_info;
  geometry_msgs::PoseStamped pose;
  sensor_msgs::PointCloud2 sparse_points;
};

/// @param stamp of all four messages
ViewMessages MakeMessages(const SyntheticView& view, const ros::Time& stamp);

sensor_msgs::PointCloud2 MakeCloud(const std::vector<Eigen::Vector3f>& points, const std::string& frame_id,
                                   const ros::Time& stamp);

/// Stamp of view `index` of a run that starts at `start_s`: 10 Hz.
ros::Time StampOf(size_t index, uint32_t start_s = 1000);

/// The frame that the mapper should make of the messages: pose and points went through quaternion and float32.
FramePtr MakeExpectedFrame(int64_t id, const ViewMessages& messages);

/// The same messages at another time.
void SetStamp(const ros::Time& stamp, ViewMessages* messages);

/// What the pipeline makes of messages without ROS: maps by the place of their message.
struct PipelineMaps {
  std::map<int64_t, KeyframeDepthPtr> fast, refined;
  size_t fast_before_flush = 0;
};
PipelineMaps MapWithoutRos(const std::vector<ViewMessages>& messages, const std::string& preset);

/// Number of pixels of a 32FC1 image that differ from a map; NaN in the message is 0 in the map. Fails for another
/// size.
int CountDifferent(const sensor_msgs::Image& message, const Image<float>& map);

/// Publishes to the topics of a mapper in a namespace.
class ScenePlayer {
 public:
  explicit ScenePlayer(ros::NodeHandle nh)
      : image(nh.advertise<sensor_msgs::Image>("image", 100)),
        camera_info(nh.advertise<sensor_msgs::CameraInfo>("camera_info", 100)),
        pose(nh.advertise<geometry_msgs::PoseStamped>("pose", 100)),
        sparse_points(nh.advertise<sensor_msgs::PointCloud2>("sparse_points", 100)) {}

  /// Blocks until the mapper has subscribed to everything; false after kTimeoutS.
  bool WaitForMapper() const;

  void Publish(const ViewMessages& messages) const;

  ros::Publisher image, camera_info, pose, sparse_points;
};

}  // namespace acmp::test
