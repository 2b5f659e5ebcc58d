// A pose in each of the messages that bring poses, and points of the older message for clouds.

#include "acmp_mapping/ros/input_conversion.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(pose) {
  using namespace acmp;
  fuzz::Bytes bytes(data, size);
  geometry_msgs::PoseStamped pose;
  fuzz::Fill(&bytes, &pose.header);
  fuzz::Fill(&bytes, &pose.pose);
  fuzz::MayRefuse([&] { ToPoseSample(pose); });
  geometry_msgs::PoseWithCovarianceStamped with_covariance;
  with_covariance.header = pose.header;
  with_covariance.pose.pose = pose.pose;
  fuzz::MayRefuse([&] { ToPoseSample(with_covariance); });
  nav_msgs::Odometry odometry;
  odometry.header = pose.header;
  odometry.child_frame_id = bytes.TakeText();
  odometry.pose.pose = pose.pose;
  fuzz::MayRefuse([&] { ToPoseSample(odometry); });
  geometry_msgs::TransformStamped transform;
  transform.header = pose.header;
  transform.child_frame_id = odometry.child_frame_id;
  transform.transform.translation.x = pose.pose.position.x;
  transform.transform.translation.y = pose.pose.position.y;
  transform.transform.translation.z = pose.pose.position.z;
  transform.transform.rotation = pose.pose.orientation;
  fuzz::MayRefuse([&] { ToPoseSample(transform); });
  sensor_msgs::PointCloud cloud;
  cloud.header = pose.header;
  for (const float x : bytes.TakeVector<float>()) {
    cloud.points.emplace_back();
    cloud.points.back().x = cloud.points.back().y = cloud.points.back().z = x;
  }
  fuzz::MayRefuse([&] { ToSparseCloud(cloud); });
  return 0;
}
