#include <gtest/gtest.h>

#include "acmp_mapping/ros/calibration_file.h"

namespace acmp {
namespace {

TEST(CalibrationTemplate, IsRead) {
  const sensor_msgs::CameraInfo info = ReadCalibrationFile(ACMP_SOURCE_DIR "/config/camera.yaml");
  EXPECT_EQ(info.width, 752u);
  EXPECT_EQ(info.height, 480u);
  EXPECT_EQ(info.distortion_model, "plumb_bob");
  EXPECT_EQ(info.K[2], 367.215);
  EXPECT_EQ(info.P[6], 248.375);
  EXPECT_EQ(info.D, (std::vector<double>{-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0}));
}

}  // namespace
}  // namespace acmp
