#include "bag_messages.h"

#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/output_conversion.h"

namespace acmp {
namespace {

struct RosDistortion {
  const std::string& name;
  size_t coefficients;
};

RosDistortion DistortionFor(LensDistortion::Model model) {
  switch (model) {
    case LensDistortion::Model::kNone:
    case LensDistortion::Model::kBrownConrady:
      return {sensor_msgs::distortion_models::PLUMB_BOB, 5};
    case LensDistortion::Model::kRational:
      return {sensor_msgs::distortion_models::RATIONAL_POLYNOMIAL, 8};
    case LensDistortion::Model::kEquidistant:
      return {sensor_msgs::distortion_models::EQUIDISTANT, 4};
  }
  throw InvalidInputError("unknown distortion model");
}

}  // namespace

sensor_msgs::CompressedImage ToCompressedMessage(const std::string& file_bytes, const std_msgs::Header& header) {
  sensor_msgs::CompressedImage message;
  message.header = header;
  message.format = file_bytes.compare(0, 4, "\x89PNG") == 0 ? "png" : "jpeg";
  message.data.assign(file_bytes.begin(), file_bytes.end());
  return message;
}

sensor_msgs::Image ToMaskMessage(const Mask& mask, const std_msgs::Header& header) {
  sensor_msgs::Image message;
  message.header = header;
  message.width = static_cast<uint32_t>(mask.width());
  message.height = static_cast<uint32_t>(mask.height());
  message.encoding = sensor_msgs::image_encodings::MONO8;
  message.step = message.width;
  message.data.assign(mask.data(), mask.data() + mask.size());
  return message;
}

sensor_msgs::CameraInfo ToCameraInfo(const PinholeCamera& camera, const LensDistortion& distortion,
                                     const std_msgs::Header& header) {
  const RosDistortion ros_distortion = DistortionFor(distortion.model);
  if (distortion.coefficients.size() > ros_distortion.coefficients) {
    throw InvalidInputError(Concat(distortion.coefficients.size(), " distortion coefficients: ", ros_distortion.name,
                                   " has at most ", ros_distortion.coefficients));
  }
  sensor_msgs::CameraInfo message = *ToCameraInfo(camera, header);
  message.distortion_model = ros_distortion.name;
  message.D = distortion.coefficients;
  message.D.resize(ros_distortion.coefficients, 0.0);
  return message;
}

geometry_msgs::PoseStamped ToPoseStamped(const RigidTransform& cam_from_world, const std_msgs::Header& header) {
  const RigidTransform world_from_cam = cam_from_world.inverse(Eigen::Isometry);
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(world_from_cam.linear()).normalized();
  geometry_msgs::PoseStamped message;
  message.header = header;
  message.pose.position.x = world_from_cam.translation().x();
  message.pose.position.y = world_from_cam.translation().y();
  message.pose.position.z = world_from_cam.translation().z();
  message.pose.orientation.x = rotation.x();
  message.pose.orientation.y = rotation.y();
  message.pose.orientation.z = rotation.z();
  message.pose.orientation.w = rotation.w();
  return message;
}

tf2_msgs::TFMessage ToTf(const geometry_msgs::PoseStamped& world_from_cam, const std::string& camera_frame) {
  geometry_msgs::TransformStamped transform;
  transform.header = world_from_cam.header;
  transform.child_frame_id = camera_frame;
  transform.transform.translation.x = world_from_cam.pose.position.x;
  transform.transform.translation.y = world_from_cam.pose.position.y;
  transform.transform.translation.z = world_from_cam.pose.position.z;
  transform.transform.rotation = world_from_cam.pose.orientation;
  tf2_msgs::TFMessage message;
  message.transforms.push_back(transform);
  return message;
}

sensor_msgs::PointCloud2 ToPointCloud2(const std::vector<Eigen::Vector3d>& points, const std_msgs::Header& header) {
  sensor_msgs::PointCloud2 message;
  message.header = header;
  message.height = 1;
  message.is_dense = true;
  sensor_msgs::PointCloud2Modifier modifier(message);
  modifier.setPointCloud2Fields(3, "x", 1, sensor_msgs::PointField::FLOAT32, "y", 1, sensor_msgs::PointField::FLOAT32,
                                "z", 1, sensor_msgs::PointField::FLOAT32);
  modifier.resize(points.size());
  if (points.empty()) return message;  // the iterator would take the address of the first byte
  sensor_msgs::PointCloud2Iterator<float> value(message, "x");
  for (const Eigen::Vector3d& point : points) {
    for (int axis = 0; axis < 3; ++axis) value[axis] = static_cast<float>(point[axis]);
    ++value;
  }
  return message;
}

}  // namespace acmp
