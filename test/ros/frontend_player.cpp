#include "ros/frontend_player.h"

#include <set>
#include <tuple>

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pcl/point_types.h>
#include <pcl_conversions/pcl_conversions.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp::test {
namespace {

constexpr int64_t kPoseIntervalNs = 5000000;  // of an IMU at 200 Hz

/// 20 Hz, a time of today: only there a double is too short for nanoseconds, and no whole microseconds.
ros::Time ImageStamp(size_t view) {
  ros::Time stamp(1403636579, 63555584);
  return stamp + ros::Duration(0, static_cast<int32_t>(view) * 50000000);
}

ros::Time Rounded(const ros::Time& stamp, StampRounding rounding) {
  switch (rounding) {
    case StampRounding::kNone:
      return stamp;
    case StampRounding::kDouble:
      return ros::Time(stamp.toSec());
    case StampRounding::kMicroseconds:
      return pcl_conversions::fromPCL(pcl_conversions::toPCL(stamp));
    case StampRounding::kSendingTime:
      return ros::Time::now();
  }
  return stamp;
}

geometry_msgs::Pose RoundedToFloat(geometry_msgs::Pose pose) {
  for (double* value : {&pose.position.x, &pose.position.y, &pose.position.z, &pose.orientation.x, &pose.orientation.y,
                        &pose.orientation.z, &pose.orientation.w}) {
    const volatile float rounded = static_cast<float>(*value);  // volatile: gcc 12 may drop the rounding
    *value = static_cast<double>(rounded);
  }
  return pose;
}

geometry_msgs::TransformStamped ToTransformStamped(const ros::Time& stamp, const std::string& parent,
                                                   const std::string& child, const geometry_msgs::Pose& pose) {
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = parent;
  transform.child_frame_id = child;
  transform.transform.translation.x = pose.position.x;
  transform.transform.translation.y = pose.position.y;
  transform.transform.translation.z = pose.position.z;
  transform.transform.rotation = pose.orientation;
  return transform;
}

template <class Point>
sensor_msgs::PointCloud2 ToPclMessage(const std::vector<Eigen::Vector3f>& points, const std_msgs::Header& header) {
  pcl::PointCloud<Point> cloud;
  for (const Eigen::Vector3f& point : points) {
    cloud.push_back(Point());
    cloud.back().getVector3fMap() = point;
  }
  sensor_msgs::PointCloud2 message;
  pcl::toROSMsg(cloud, message);
  message.header = header;
  return message;
}

sensor_msgs::PointCloud ToPointCloudV1(const std::vector<Eigen::Vector3f>& points, const std_msgs::Header& header) {
  sensor_msgs::PointCloud cloud;
  cloud.header = header;
  for (const Eigen::Vector3f& point : points) {
    geometry_msgs::Point32 position;
    position.x = point.x();
    position.y = point.y();
    position.z = point.z();
    sensor_msgs::ChannelFloat32
        channel;  // normalised x, y, pixel u, v, id: one channel per point, against the contract
    channel.values = {0.1f, 0.2f, 30.f, 40.f, static_cast<float>(cloud.points.size())};
    cloud.points.push_back(position);
    cloud.channels.push_back(channel);
  }
  return cloud;
}

}  // namespace

FrontendPlayer::FrontendPlayer(ros::NodeHandle nh, const FrontendTraits& traits,
                               const std::vector<SyntheticView>& views)
    : traits_(traits) {
  Estimate(views);
  image_ = nh.advertise<sensor_msgs::Image>(traits.image_topic, 100);
  switch (traits.pose_message) {
    case PoseMessage::kPoseStamped:
      pose_ = nh.advertise<geometry_msgs::PoseStamped>(traits.pose_topic, 100);
      break;
    case PoseMessage::kOdometry:
      pose_ = nh.advertise<nav_msgs::Odometry>(traits.pose_topic, 100);
      break;
    case PoseMessage::kTf:
      pose_ = nh.advertise<tf2_msgs::TFMessage>(traits.pose_topic, 100);
      break;
  }
  cloud_ = traits.cloud_message == CloudMessage::kChannelPerPoint
               ? nh.advertise<sensor_msgs::PointCloud>(traits.cloud_topic, 100)
               : nh.advertise<sensor_msgs::PointCloud2>(traits.cloud_topic, 100);
  connected_ = {image_, pose_, cloud_};
  if (!traits.camera_info_topic.empty()) {
    camera_info_ = nh.advertise<sensor_msgs::CameraInfo>(traits.camera_info_topic, 100);
    connected_.push_back(camera_info_);
  }
  if (!traits.extrinsic_topic.empty()) {
    extrinsic_ = nh.advertise<nav_msgs::Odometry>(traits.extrinsic_topic, 100);
    connected_.push_back(extrinsic_);
  }
  if (!traits.path_topic.empty()) {
    path_ = nh.advertise<nav_msgs::Path>(traits.path_topic, 100);
    connected_.push_back(path_);
  }
  if (!traits.static_transforms.empty()) static_tf_ = nh.advertise<tf2_msgs::TFMessage>("/tf_static", 100, true);
}

void FrontendPlayer::Estimate(const std::vector<SyntheticView>& views) {
  std::set<std::tuple<float, float, float>> seen;
  for (size_t i = 0; i < views.size(); ++i) {
    stamps_.push_back(ImageStamp(i));
    ViewMessages plain = MakeMessages(views[i], stamps_[i]);
    plain.image.header.frame_id = plain.camera_info.header.frame_id = traits_.image_frame;
    if (traits_.float_poses) plain.pose.pose = RoundedToFloat(plain.pose.pose);
    images_.push_back({plain.image, plain.camera_info});
    plain_.push_back(plain);

    observed_.emplace_back();
    for (const Eigen::Vector3d& landmark : views[i].frame.landmarks_in_world) {
      const Eigen::Vector3f point = landmark.cast<float>();
      observed_[i].push_back(point);
      if (seen.emplace(point.x(), point.y(), point.z()).second) map_.push_back(point);
    }

    const RigidTransform scene_from_cam = ToTransform(plain.pose.pose);
    RigidTransform world_from_scene = RigidTransform::Identity();
    world_from_scene.linear() = traits_.world_from_scene;
    world_from_cam_.push_back(world_from_scene * scene_from_cam);
    poses_.push_back(traits_.SendsSameNumbers() ? plain.pose.pose
                                                : tf2::toMsg(world_from_cam_[i] * traits_.child_from_cam.inverse()));
  }
  const size_t posed = views.size() - traits_.pose_delay;
  plain_.resize(posed);
  world_from_cam_.resize(posed);
  for (size_t i = 0; i < posed; ++i) {
    plain_[i].sparse_points = MakeCloud(traits_.whole_map ? map_ : observed_[i], kWorldFrame, stamps_[i]);
  }
}

bool FrontendPlayer::WaitForMapper(double timeout_s, std::string* missing) const {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(timeout_s);
  for (;;) {
    missing->clear();
    for (const ros::Publisher& publisher : connected_) {
      if (publisher.getNumSubscribers() == 0) *missing += " " + publisher.getTopic();
    }
    if (missing->empty()) return true;
    if (!ros::ok() || ros::WallTime::now() > end) return false;
    ros::WallDuration(0.02).sleep();
  }
}

void FrontendPlayer::Play() const {
  PublishStaticTransforms();
  for (size_t i = 0; i < images_.size(); ++i) {
    if (camera_info_) camera_info_.publish(images_[i].camera_info);
    image_.publish(images_[i].image);
    if (i < traits_.pose_delay) continue;
    const size_t posed = i - traits_.pose_delay;
    if (extrinsic_) PublishExtrinsic(stamps_[i]);
    PublishPoses(posed);
    PublishCloud(posed);
  }
}

void FrontendPlayer::PublishPath(const RigidTransform& correction) const {
  nav_msgs::Path path;
  for (size_t i = 0; i < world_from_cam_.size(); ++i) {
    geometry_msgs::PoseStamped pose;
    pose.header.stamp = Rounded(stamps_[i], traits_.pose_stamp);
    pose.header.frame_id = traits_.path_frame;
    pose.pose = tf2::toMsg(correction * ToTransform(poses_[i]));
    path.poses.push_back(pose);
  }
  path.header = path.poses.back().header;
  path_.publish(path);
}

void FrontendPlayer::PublishPoses(size_t view) const {
  PublishPose(Rounded(stamps_[view], traits_.pose_stamp), poses_[view]);
  if (traits_.poses_per_image == 1 || view + 1 == poses_.size()) return;
  // Those in between belong to no image; how good they are does not matter.
  const RigidTransform from = ToTransform(poses_[view]);
  const RigidTransform to = ToTransform(poses_[view + 1]);
  const Eigen::Quaterniond start(from.linear());
  const double step =
      static_cast<double>(kPoseIntervalNs) / static_cast<double>((stamps_[view + 1] - stamps_[view]).toNSec());
  for (int k = 1; k < traits_.poses_per_image; ++k) {
    RigidTransform between = RigidTransform::Identity();
    between.linear() = start.slerp(k * step, Eigen::Quaterniond(to.linear())).toRotationMatrix();
    between.translation() = from.translation() + k * step * (to.translation() - from.translation());
    PublishPose(stamps_[view] + ros::Duration(0, static_cast<int32_t>(k * kPoseIntervalNs)), tf2::toMsg(between));
  }
}

void FrontendPlayer::PublishPose(const ros::Time& stamp, const geometry_msgs::Pose& pose) const {
  switch (traits_.pose_message) {
    case PoseMessage::kPoseStamped: {
      geometry_msgs::PoseStamped message;
      message.header.stamp = stamp;
      message.header.frame_id = traits_.world_frame;
      message.pose = pose;
      pose_.publish(message);
      break;
    }
    case PoseMessage::kOdometry: {
      nav_msgs::Odometry message;
      message.header.stamp = stamp;
      message.header.frame_id = traits_.world_frame;
      message.child_frame_id = traits_.child_frame;
      message.pose.pose = pose;
      pose_.publish(message);
      break;
    }
    case PoseMessage::kTf: {
      tf2_msgs::TFMessage message;
      message.transforms.push_back(ToTransformStamped(stamp, traits_.world_frame, traits_.child_frame, pose));
      pose_.publish(message);
      break;
    }
  }
}

std::vector<Eigen::Vector3f> FrontendPlayer::PublishedPoints(size_t view) const {
  std::vector<Eigen::Vector3f> points;
  const Eigen::Matrix3f world_from_scene = traits_.world_from_scene.cast<float>();
  for (const Eigen::Vector3f& point : traits_.whole_map ? map_ : observed_[view]) {
    if (traits_.zero_points && points.size() % 3 == 0) points.push_back(Eigen::Vector3f::Zero());
    points.push_back(world_from_scene * point);
  }
  return points;
}

void FrontendPlayer::PublishCloud(size_t view) const {
  const std::vector<Eigen::Vector3f> points = PublishedPoints(view);
  std_msgs::Header header;
  header.stamp = Rounded(stamps_[view], traits_.cloud_stamp);
  header.frame_id = traits_.cloud_frame;
  switch (traits_.cloud_message) {
    case CloudMessage::kXyz:
      cloud_.publish(MakeCloud(points, header.frame_id, header.stamp));
      break;
    case CloudMessage::kPclXyz:
      cloud_.publish(ToPclMessage<pcl::PointXYZ>(points, header));
      break;
    case CloudMessage::kPclXyzRgb:
      cloud_.publish(ToPclMessage<pcl::PointXYZRGB>(points, header));
      break;
    case CloudMessage::kChannelPerPoint:
      cloud_.publish(ToPointCloudV1(points, header));
      break;
  }
}

void FrontendPlayer::PublishExtrinsic(const ros::Time& stamp) const {
  nav_msgs::Odometry message;
  message.header.stamp = Rounded(stamp, traits_.pose_stamp);
  message.header.frame_id = traits_.world_frame;  // VINS: "world", which it is not
  message.pose.pose = tf2::toMsg(traits_.child_from_cam);
  extrinsic_.publish(message);
}

void FrontendPlayer::PublishStaticTransforms() const {
  if (traits_.static_transforms.empty()) return;
  tf2_msgs::TFMessage message;
  for (const StaticTransform& t : traits_.static_transforms) {
    message.transforms.push_back(
        ToTransformStamped(stamps_.front(), t.parent, t.child, tf2::toMsg(t.parent_from_child)));
  }
  static_tf_.publish(message);
}

}  // namespace acmp::test
