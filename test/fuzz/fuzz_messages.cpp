// Conversions of messages.

#include <ros/serialization.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <boost/array.hpp>
#include <boost/make_shared.hpp>
#include <type_traits>

#include "acmp_mapping/image/rectifier.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/pose_sources.h"
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

constexpr int kLargeSide = 64;  // of an image: larger ones take memory and time
const PinholeCamera kSmallCamera = {8, 6};

template <class Message>
boost::shared_ptr<Message> Take(fuzz::Bytes* bytes) {
  const auto message = boost::make_shared<Message>();
  AnyValues{bytes}.next(*message);
  return message;
}

/// A calibration file; the first byte says whether it is .yaml or .ini.
ACMP_FUZZ_TARGET(calibration_file) {
  const char* name = bytes.Take<char>() == 'i' ? "camera.ini" : "camera.yaml";
  ToCalibration(ReadCalibrationFile(fuzz::Write(name, bytes.Rest()).string()), false);
}

/// A CameraInfo, the undistortion of an image and a mask by it, and the faces of its lens.
ACMP_FUZZ_TARGET(camera_info) {
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
}

/// An Image and a CompressedImage, of the camera's size or of any.
ACMP_FUZZ_TARGET(image_message) {
  const bool is_raw = bytes.TakeBool();
  const auto raw = is_raw ? Take<sensor_msgs::Image>(&bytes) : nullptr;
  const auto compressed = is_raw ? nullptr : Take<sensor_msgs::CompressedImage>(&bytes);
  ImageDecoder().Decode({raw, compressed}, &kSmallCamera);
}

/// A whole Keyframe through the intake and what the worker does with its image.
ACMP_FUZZ_TARGET(keyframe) {
  NodeOptions options;
  options.keyframe_mode = KeyframeMode::kExternal;
  KeyframeIntake intake(options, 0);
  for (int i = 0; i < 2; ++i) {
    const auto keyframe = Take<acmp_mapping::Keyframe>(&bytes);
    fuzz::MayRefuse([&] { intake.AddKeyframe(keyframe); });
  }
  for (const IntakeEvent& event : intake.TakeAll()) {
    const auto* input = std::get_if<KeyframeInput>(&event);
    if (!input) continue;
    const PinholeCamera& camera = input->calibration->camera;
    if (camera.width > kLargeSide || camera.height > kLargeSide) continue;
    fuzz::MayRefuse(
        [&] { Rectifier(input->calibration->MakeLens()).Rectify(ImageDecoder().Decode(*input->image, &camera)); });
  }
}

/// Two KeyframePoints and an optimized_path into a map, as map_server does.
ACMP_FUZZ_TARGET(keyframe_points) {
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
}

/// Labels for a camera of 8 x 6 pixels.
ACMP_FUZZ_TARGET(label_message) { DecodeLabels(*ToLabelSample(Take<sensor_msgs::Image>(&bytes)).image, kSmallCamera); }

/// A mask for a camera of 8 x 6 pixels.
ACMP_FUZZ_TARGET(mask_message) { DecodeMask(*ToMaskSample(Take<sensor_msgs::Image>(&bytes)).image, kSmallCamera); }

/// A PointCloud2 as sparse points and as points of a keyframe.
ACMP_FUZZ_TARGET(point_cloud) {
  const auto cloud = Take<sensor_msgs::PointCloud2>(&bytes);
  fuzz::MayRefuse([&] { ToSparseCloud(*cloud); });
  ToPointCloud(*cloud);
}

/// One of the messages that bring poses, or points of the older message for clouds; the first byte says which.
ACMP_FUZZ_TARGET(pose) {
  const int wanted = bytes.Take<uint8_t>();
  int kind = 0;
  ForEachPoseSource([&](const auto& source) {
    if (kind++ == wanted) source.convert(*Take<typename std::decay_t<decltype(source)>::MessageType>(&bytes));
  });
  if (kind == wanted) ToSparseCloud(*Take<sensor_msgs::PointCloud>(&bytes));
}

/// Depth from outside.
ACMP_FUZZ_TARGET(prior_depth_message) { DecodePriorDepth(*ToPriorDepthSample(Take<sensor_msgs::Image>(&bytes)).image); }

}  // namespace
}  // namespace acmp
