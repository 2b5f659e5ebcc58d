// A CameraInfo, and the undistortion of an image and a mask by it.

#include "acmp_mapping/ros/input_conversion.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(camera_info) {
  using namespace acmp;
  constexpr int kLargeSide = 64;  // larger ones take memory and time
  fuzz::Bytes bytes(data, size);
  sensor_msgs::CameraInfo info;
  fuzz::Fill(&bytes, &info);
  for (const bool rectified : {false, true}) {
    fuzz::MayRefuse([&] {
      const CameraCalibration calibration = ToCalibration(info, rectified);
      const int width = calibration.camera.width, height = calibration.camera.height;
      if (width > kLargeSide || height > kLargeSide) return;
      ImageRectifier rectifier(calibration);
      rectifier.Rectify(cv::Mat::zeros(height, width, CV_8UC3));
      rectifier.RectifyMask(Mask(width, height, 1));
    });
  }
  return 0;
}
