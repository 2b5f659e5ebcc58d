#pragma once

#include <functional>
#include <string>
#include <vector>

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>

#include "acmp_mapping/ros/mapper_worker.h"

namespace acmp {

/// All output topics. A message is only made when somebody listens. Methods belong to the worker thread; PublishMap and
/// PublishPath may run in others, since ros::Publisher is thread-safe.
class OutputPublisher {
 public:
  /// @param on_map_subscriber called when somebody subscribes to the map
  OutputPublisher(ros::NodeHandle nh, const std::function<void()>& on_map_subscriber);

  void PublishFast(const KeyframeOutput& output);
  void PublishRefined(const KeyframeOutput& output);
  /// Throws InvalidInputError for a map of more than 1 GB: roscpp's subscribers hang up on such messages.
  void PublishMap(const PointCloud& map, const std::string& world_frame, int64_t stamp_ns);
  /// Stamped as its last pose; an empty one is not published.
  void PublishPath(const std::vector<StampedPose>& poses, const std::string& world_frame);
  bool map_wanted() const { return map_.getNumSubscribers() > 0; }

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
  ros::Publisher map_;
  ros::Publisher pose_;
  ros::Publisher path_;
  ros::Publisher keyframe_depth_;
};

}  // namespace acmp
