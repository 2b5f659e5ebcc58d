#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <acmp_mapping/KeyframePoints.h>
#include <image_transport/image_transport.h>
#include <ros/node_handle.h>

#include "acmp_mapping/ros/keyframe_outputs.h"

namespace acmp {

/// The output topics of a mapper. A message is only made when somebody listens. Methods belong to one thread, but for
/// those that say otherwise.
class OutputPublisher {
 public:
  /// @param mapper name of the mapper's node, for the map
  /// @param images_under_way how many images the mapper has received and not finished
  OutputPublisher(ros::NodeHandle nh, std::string mapper, std::function<uint64_t()> images_under_way);

  void PublishFast(const KeyframeOutput& output);
  void PublishRefined(const KeyframeOutput& output);
  /// Better points of a keyframe, for the map alone.
  void PublishRefinedAgain(const KeyframeOutput& output) { PublishKeyframePoints(output, true); }

  /// Nodes that listen to keyframe_points. Any thread.
  uint32_t maps() const { return keyframe_points_.getNumSubscribers(); }
  /// Messages sent on keyframe_points. Any thread.
  uint64_t points_sent() const { return points_sent_; }

 private:
  void PublishKeyframePoints(const KeyframeOutput& output, bool replaces);
  void PublishPose(const KeyframeOutput& output);
  void PublishPictures(const KeyframeOutput& output, const std_msgs::Header& camera);
  void PublishKeyframeDepth(const KeyframeOutput& output, const std_msgs::Header& camera);

  const std::string mapper_;
  const std::function<uint64_t()> images_under_way_;
  std::vector<acmp_mapping::KeyframePointsPtr> waiting_;  ///< for the first map that listens
  std::atomic<uint64_t> points_sent_{0};
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
  ros::Publisher keyframe_points_;
  ros::Publisher keyframe_depth_;
};

}  // namespace acmp
