#pragma once

#include <string>
#include <vector>

#include <ros/ros.h>
#include <sensor_msgs/PointCloud.h>

#include "ros/frontend_traits.h"
#include "ros/scene_player.h"

namespace acmp::test {

/// Plays the synthetic scene as a frontend would publish it, on its topics.
class FrontendPlayer {
 public:
  /// @param views more than the traits' pose_delay: the last ones get no pose
  FrontendPlayer(ros::NodeHandle nh, const FrontendTraits& traits, const std::vector<SyntheticView>& views);

  /// The same estimates as the plainest frontend would publish them, of all views that get a pose: PoseStamped of the
  /// optical frame, PointCloud2 in the world, equal stamps.
  const std::vector<ViewMessages>& plain() const { return plain_; }

  /// Poses of the optical frame in the frontend's world, of the same views.
  const std::vector<RigidTransform>& world_from_cam() const { return world_from_cam_; }

  /// The stamps of the images.
  const ros::Time& stamp(size_t view) const { return stamps_.at(view); }

  /// Blocks until somebody has subscribed to everything; false after `timeout_s`, with what is missing in `missing`.
  bool WaitForMapper(double timeout_s, std::string* missing) const;

  void Play() const;

  /// A loop closure: all poses again, in a world that has moved by `correction`. Needs a path_topic.
  void PublishPath(const RigidTransform& correction) const;

 private:
  /// One image of the camera.
  struct CameraImage {
    sensor_msgs::Image image;
    sensor_msgs::CameraInfo camera_info;
  };

  void Estimate(const std::vector<SyntheticView>& views);
  std::vector<Eigen::Vector3f> PublishedPoints(size_t view) const;
  void PublishPoses(size_t view) const;
  void PublishPose(const ros::Time& stamp, const geometry_msgs::Pose& pose) const;
  void PublishCloud(size_t view) const;
  void PublishExtrinsic(const ros::Time& stamp) const;
  void PublishStaticTransforms() const;

  FrontendTraits traits_;
  std::vector<ros::Time> stamps_;
  std::vector<CameraImage> images_;
  std::vector<ViewMessages> plain_;
  std::vector<RigidTransform> world_from_cam_;
  std::vector<geometry_msgs::Pose> poses_;              ///< as published
  std::vector<std::vector<Eigen::Vector3f>> observed_;  ///< points of each image, in the scene's world
  std::vector<Eigen::Vector3f> map_;                    ///< all of them, in the scene's world
  std::vector<ros::Publisher> connected_;               ///< those that the mapper has to subscribe to
  ros::Publisher image_, camera_info_, pose_, cloud_, extrinsic_, path_, static_tf_;
};

}  // namespace acmp::test
