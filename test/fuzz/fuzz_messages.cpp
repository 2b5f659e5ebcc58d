// Conversions of messages.

#include <geometry_msgs/Pose.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <algorithm>
#include <boost/make_shared.hpp>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/image/rectifier.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "fuzz/fuzz_input.h"

/// Messages with any values. They are not deserialised from ROS's bytes: roscpp asks for as much memory as a length in
/// them says.
namespace acmp::fuzz {
namespace {

void Fill(Bytes* bytes, std_msgs::Header* header) {
  header->stamp.sec = bytes->Take<uint32_t>();
  header->stamp.nsec = bytes->Take<uint32_t>();
  header->frame_id = bytes->TakeText();
}

void Fill(Bytes* bytes, geometry_msgs::Pose* pose) {
  for (double* value : {&pose->position.x, &pose->position.y, &pose->position.z, &pose->orientation.x,
                        &pose->orientation.y, &pose->orientation.z, &pose->orientation.w}) {
    *value = bytes->Take<double>();
  }
}

void Fill(Bytes* bytes, sensor_msgs::CameraInfo* info) {
  Fill(bytes, &info->header);
  info->width = bytes->Take<uint32_t>();
  info->height = bytes->Take<uint32_t>();
  info->distortion_model = bytes->TakeText();
  info->D = bytes->TakeVector<double>();
  for (double& value : info->K) value = bytes->Take<double>();
  for (double& value : info->P) value = bytes->Take<double>();
  for (uint32_t* value : {&info->binning_x, &info->binning_y, &info->roi.x_offset, &info->roi.y_offset,
                          &info->roi.width, &info->roi.height}) {
    *value = bytes->Take<uint32_t>();
  }
}

void Fill(Bytes* bytes, sensor_msgs::Image* image) {
  Fill(bytes, &image->header);
  image->width = bytes->Take<uint32_t>();
  image->height = bytes->Take<uint32_t>();
  image->encoding = bytes->TakeText();
  image->is_bigendian = bytes->Take<uint8_t>();
  image->step = bytes->Take<uint32_t>();
  image->data = bytes->TakeVector<uint8_t>();
}

void Fill(Bytes* bytes, sensor_msgs::CompressedImage* image) {
  Fill(bytes, &image->header);
  image->format = bytes->TakeText();
  image->data = bytes->TakeVector<uint8_t>();
}

void Fill(Bytes* bytes, sensor_msgs::PointCloud2* cloud) {
  Fill(bytes, &cloud->header);
  cloud->width = bytes->Take<uint32_t>();
  cloud->height = bytes->Take<uint32_t>();
  cloud->fields.resize(bytes->Take<uint8_t>() % 16);
  for (sensor_msgs::PointField& field : cloud->fields) {
    field.name = bytes->TakeText();
    field.offset = bytes->Take<uint32_t>();
    field.datatype = bytes->Take<uint8_t>();
    field.count = bytes->Take<uint32_t>();
  }
  cloud->is_bigendian = bytes->TakeBool();
  cloud->point_step = bytes->Take<uint32_t>();
  cloud->row_step = bytes->Take<uint32_t>();
  cloud->is_dense = bytes->TakeBool();
  cloud->data = bytes->TakeVector<uint8_t>();
}

}  // namespace
}  // namespace acmp::fuzz

namespace acmp {
namespace {

/// A calibration file; the first byte says whether it is .yaml or .ini.
ACMP_FUZZ_TARGET(calibration_file) {
  static const fuzz::Folder folder;
  fuzz::Bytes bytes(data, size);
  const char* name = bytes.Take<char>() == 'i' ? "camera.ini" : "camera.yaml";
  const auto path = folder.Write(name, bytes.Rest());
  fuzz::MayRefuse([&] { ToCalibration(ReadCalibrationFile(path.string()), false); });
  return 0;
}

/// A CameraInfo, the undistortion of an image and a mask by it, and the faces of its lens.
ACMP_FUZZ_TARGET(camera_info) {
  constexpr int kLargeSide = 64;  // larger ones take memory and time
  fuzz::Bytes bytes(data, size);
  sensor_msgs::CameraInfo info;
  fuzz::Fill(&bytes, &info);
  for (const bool rectified : {false, true}) {
    fuzz::MayRefuse([&] {
      const CameraCalibration calibration = ToCalibration(info, rectified);
      const int width = calibration.camera.width, height = calibration.camera.height;
      if (width > kLargeSide || height > kLargeSide) return;
      const Lens lens = calibration.MakeLens();
      Rectifier rectifier(lens);
      rectifier.Rectify(cv::Mat::zeros(height, width, CV_8UC3));
      rectifier.RectifyMask(Mask(width, height, 1));
      if (FacesOf(lens).empty()) std::abort();  // the mapper takes the first one
    });
  }
  return 0;
}

/// An Image and a CompressedImage, of the camera's size or of any.
ACMP_FUZZ_TARGET(image_message) {
  fuzz::Bytes bytes(data, size);
  PinholeCamera camera;
  camera.width = 8;
  camera.height = 6;
  if (bytes.TakeBool()) {
    const auto raw = boost::make_shared<sensor_msgs::Image>();
    fuzz::Fill(&bytes, raw.get());
    fuzz::MayRefuse([&] { DecodeRgb({raw, nullptr}, &camera); });
  } else {
    const auto compressed = boost::make_shared<sensor_msgs::CompressedImage>();
    fuzz::Fill(&bytes, compressed.get());
    fuzz::MayRefuse([&] { DecodeRgb({nullptr, compressed}, &camera); });
  }
  return 0;
}

/// A whole Keyframe through the intake and what the worker does with its image.
ACMP_FUZZ_TARGET(keyframe) {
  constexpr int kLargeSide = 64;  // larger ones take memory and time
  fuzz::Bytes bytes(data, size);
  NodeOptions options;
  options.keyframe_mode = KeyframeMode::kExternal;
  KeyframeIntake intake(options, {}, 0);
  for (int i = 0; i < 2; ++i) {
    const auto keyframe = boost::make_shared<acmp_mapping::Keyframe>();
    fuzz::Fill(&bytes, &keyframe->header);
    fuzz::Fill(&bytes, &keyframe->pose);
    keyframe->child_frame_id = bytes.TakeText();
    fuzz::Fill(&bytes, &keyframe->camera_info);
    fuzz::Fill(&bytes, &keyframe->points);
    fuzz::Fill(&bytes, &keyframe->image);
    fuzz::Fill(&bytes, &keyframe->compressed_image);
    fuzz::MayRefuse([&] { intake.AddKeyframe(keyframe); });
  }
  for (const IntakeEvent& event : intake.TakeAll()) {
    const auto* input = std::get_if<KeyframeInput>(&event);
    if (!input) continue;
    const PinholeCamera& camera = input->calibration->camera;
    if (camera.width > kLargeSide || camera.height > kLargeSide) continue;
    fuzz::MayRefuse([&] { Rectifier(input->calibration->MakeLens()).Rectify(DecodeRgb(*input->image, &camera)); });
  }
  return 0;
}

/// Two KeyframePoints and an optimized_path into a map, as map_server does.
ACMP_FUZZ_TARGET(keyframe_points) {
  fuzz::Bytes bytes(data, size);
  MapStore map({});
  for (int i = 0; i < 2; ++i) {
    acmp_mapping::KeyframePoints message;
    fuzz::Fill(&bytes, &message.header);
    message.mapper = bytes.TakeText();
    message.run = bytes.Take<uint8_t>();
    message.id = bytes.Take<uint8_t>();
    message.replaces = bytes.TakeBool();
    message.path_inverted = bytes.TakeBool();
    message.path_tolerance = bytes.Take<double>();
    for (double& value : message.T_world_cam) value = bytes.Take<double>();
    for (double& value : message.path_T_child_cam) value = bytes.Take<double>();
    message.refined_world = bytes.Take<uint8_t>();
    message.refined_scale = bytes.Take<double>();
    for (double& value : message.T_refined_cam) value = bytes.Take<double>();
    for (double& value : message.T_received_cam) value = bytes.Take<double>();
    message.camera_info = *ToCameraInfo({64, 48, 50, 50, 31.5, 23.5}, message.header);  // has a target of its own
    fuzz::Fill(&bytes, &message.points);
    fuzz::MayRefuse([&] {
      const KeyframePointsHead head = ReadHead(message);
      const PointCloud points = ToPointCloud(message.points);
      if (message.replaces) {
        map.Replace(head.key, head.pose, points);
      } else {
        map.Add(head.key, head.pose, points);
      }
    });
  }
  while (map.LookAroundNext()) continue;
  nav_msgs::Path path;
  path.poses.resize(bytes.Take<uint8_t>() % 8);
  for (geometry_msgs::PoseStamped& pose : path.poses) {
    fuzz::Fill(&bytes, &pose.header);
    fuzz::Fill(&bytes, &pose.pose);
  }
  fuzz::MayRefuse([&] {
    const OptimizedPath poses = ToOptimizedPath(path, "map", [](const RejectedInput&) {});
    const ReposeResult result = map.Repose(poses.poses);
    DescribeDoubt(poses, result, "map");
    DescribeTooFar(result);
  });
  fuzz::MayRefuse([&] { map.WorldCloud(); });  // also what is too far away for its voxels
  map.Path();
  return 0;
}

/// A mask for a camera of 8 x 6 pixels.
ACMP_FUZZ_TARGET(mask_message) {
  fuzz::Bytes bytes(data, size);
  const auto message = boost::make_shared<sensor_msgs::Image>();
  fuzz::Fill(&bytes, message.get());
  PinholeCamera camera;
  camera.width = 8;
  camera.height = 6;
  fuzz::MayRefuse([&] { DecodeMask(*ToMaskSample(message).image, camera); });
  return 0;
}

/// A PointCloud2 as sparse points and as points of a keyframe.
ACMP_FUZZ_TARGET(point_cloud) {
  fuzz::Bytes bytes(data, size);
  sensor_msgs::PointCloud2 cloud;
  fuzz::Fill(&bytes, &cloud);
  fuzz::MayRefuse([&] { ToSparseCloud(cloud); });
  fuzz::MayRefuse([&] { ToPointCloud(cloud); });
  return 0;
}

/// A pose in each of the messages that bring poses, and points of the older message for clouds.
ACMP_FUZZ_TARGET(pose) {
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

/// Depth from outside.
ACMP_FUZZ_TARGET(prior_depth_message) {
  fuzz::Bytes bytes(data, size);
  const auto message = boost::make_shared<sensor_msgs::Image>();
  fuzz::Fill(&bytes, message.get());
  fuzz::MayRefuse([&] { DecodePriorDepth(*ToPriorDepthSample(message).image); });
  return 0;
}

}  // namespace
}  // namespace acmp
