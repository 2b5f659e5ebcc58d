#include "acmp_mapping/ros/calibration_file.h"

#include <exception>
#include <filesystem>

#include <camera_calibration_parsers/parse.h>

#include "acmp_mapping/common/error.h"

namespace acmp {

sensor_msgs::CameraInfo ReadCalibrationFile(const std::string& path) {
  const std::string what = Concat("calibration_file = \"", path, "\": ");
  if (!std::filesystem::is_regular_file(path)) throw InvalidInputError(what + "there is no such file");
  std::string camera_name;
  sensor_msgs::CameraInfo info;
  bool read = false;
  try {
    read = camera_calibration_parsers::readCalibration(path, camera_name, info);
  } catch (const std::exception& error) {
    throw InvalidInputError(what + error.what());
  }
  if (!read) {
    throw InvalidInputError(what + "must be a .yaml, .yml or .ini file as camera_calibration writes them");
  }
  return info;
}

}  // namespace acmp
