// Conversions of messages.

#include <ros/serialization.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <boost/array.hpp>
#include <boost/make_shared.hpp>
#include <type_traits>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/image/rectifier.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "fuzz/fuzz_input.h"

namespace acmp {
namespace {

/// Gives a message any values, field by field in the order of its definition. ROS's own stream asks for as much memory
/// as a length says.
struct AnyValues {
  template <class T>
  void next(T& value) {
    if constexpr (std::is_arithmetic_v<T>) {
      value = bytes->Take<T>();
    } else {
      ros::serialization::Serializer<T>::template allInOne<AnyValues, T&>(*this, value);
    }
  }
  void next(std::string& text) { text = bytes->TakeText(); }
  void next(ros::Time& time) {
    next(time.sec);
    next(time.nsec);
  }
  template <class T, size_t kCount>
  void next(boost::array<T, kCount>& values) {
    for (T& value : values) next(value);
  }
  template <class T>
  void next(std::vector<T>& values) {
    values.resize(bytes->TakeCount(std::is_arithmetic_v<T> ? sizeof(T) : 1));
    for (T& value : values) next(value);
  }

  fuzz::Bytes* bytes;
};

template <class Message>
boost::shared_ptr<Message> Take(fuzz::Bytes* bytes) {
  const auto message = boost::make_shared<Message>();
  AnyValues{bytes}.next(*message);
  return message;
}

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
  const auto info = Take<sensor_msgs::CameraInfo>(&bytes);
  for (const bool rectified : {false, true}) {
    fuzz::MayRefuse([&] {
      const CameraCalibration calibration = ToCalibration(*info, rectified);
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
    const auto raw = Take<sensor_msgs::Image>(&bytes);
    fuzz::MayRefuse([&] { DecodeRgb({raw, nullptr}, &camera); });
  } else {
    const auto compressed = Take<sensor_msgs::CompressedImage>(&bytes);
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
    const auto keyframe = Take<acmp_mapping::Keyframe>(&bytes);
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
    const auto message = Take<acmp_mapping::KeyframePoints>(&bytes);
    // Has a target of its own; one of any size takes any memory.
    message->camera_info = *ToCameraInfo({64, 48, 50, 50, 31.5, 23.5}, message->header);
    fuzz::MayRefuse([&] {
      const KeyframePointsHead head = ReadHead(*message);
      const PointCloud points = ToPointCloud(message->points);
      if (message->replaces) {
        map.Replace(head.key, head.pose, points);
      } else {
        map.Add(head.key, head.pose, points);
      }
    });
  }
  while (map.LookAroundNext()) continue;
  const auto path = Take<nav_msgs::Path>(&bytes);
  fuzz::MayRefuse([&] {
    const OptimizedPath poses = ToOptimizedPath(*path, "map", [](const RejectedInput&) {});
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
  const auto message = Take<sensor_msgs::Image>(&bytes);
  PinholeCamera camera;
  camera.width = 8;
  camera.height = 6;
  fuzz::MayRefuse([&] { DecodeMask(*ToMaskSample(message).image, camera); });
  return 0;
}

/// A PointCloud2 as sparse points and as points of a keyframe.
ACMP_FUZZ_TARGET(point_cloud) {
  fuzz::Bytes bytes(data, size);
  const auto cloud = Take<sensor_msgs::PointCloud2>(&bytes);
  fuzz::MayRefuse([&] { ToSparseCloud(*cloud); });
  fuzz::MayRefuse([&] { ToPointCloud(*cloud); });
  return 0;
}

/// One of the messages that bring poses, or points of the older message for clouds; the first byte says which.
ACMP_FUZZ_TARGET(pose) {
  fuzz::Bytes bytes(data, size);
  const int kind = bytes.Take<uint8_t>();
  fuzz::MayRefuse([&] {
    if (kind == 0) ToPoseSample(*Take<geometry_msgs::PoseStamped>(&bytes));
    if (kind == 1) ToPoseSample(*Take<geometry_msgs::PoseWithCovarianceStamped>(&bytes));
    if (kind == 2) ToPoseSample(*Take<nav_msgs::Odometry>(&bytes));
    if (kind == 3) ToPoseSample(*Take<geometry_msgs::TransformStamped>(&bytes));
    if (kind == 4) ToSparseCloud(*Take<sensor_msgs::PointCloud>(&bytes));
  });
  return 0;
}

/// Depth from outside.
ACMP_FUZZ_TARGET(prior_depth_message) {
  fuzz::Bytes bytes(data, size);
  const auto message = Take<sensor_msgs::Image>(&bytes);
  fuzz::MayRefuse([&] { DecodePriorDepth(*ToPriorDepthSample(message).image); });
  return 0;
}

}  // namespace
}  // namespace acmp
