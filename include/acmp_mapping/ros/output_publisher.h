#pragma once

#include <vector>

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>

#include "acmp_mapping/ros/mapper_worker.h"

namespace acmp {

/// All output topics but the map's. A message is only made when somebody listens. Methods belong to the worker thread;
/// PublishPath may run in others, since ros::Publisher is thread-safe.
class OutputPublisher {
 public:
  explicit OutputPublisher(ros::NodeHandle nh);

  void PublishFast(const KeyframeOutput& output);
  void PublishRefined(const KeyframeOutput& output);
  /// Stamped as its last pose; an empty one is not published.
  void PublishPath(const std::vector<StampedPose>& poses, const std::string& world_frame);

 private:
  void PublishPose(const KeyframeOutput& output);
  void PublishPictures(const KeyframeOutput& output, const std_msgs::Header& camera);
  void PublishKeyframeDepth(const KeyframeOutput& output, const std_msgs::Header& camera);

  image_transport::ImageTransport transport_;
  image_transport::CameraPublisher depth_fast_;
  image_transport::CameraPublisher depth_;
  image_transport::CameraPublisher color_;
  image_transport::Publisher depth_picture_;
  image_transport::Publisher confidence_;
  image_transport::Publisher confidence_picture_;
  image_transport::Publisher normal_;
  image_transport::Publisher normal_picture_;
  ros::Publisher depth_millimetres_;
  ros::Publisher points_;
  ros::Publisher pose_;
  ros::Publisher path_;
  ros::Publisher keyframe_depth_;
};

}  // namespace acmp
