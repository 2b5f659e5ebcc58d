#pragma once

#include <string>

#include <sensor_msgs/CameraInfo.h>

namespace acmp {

/// Reads what camera_calibration writes: YAML (.yaml, .yml) or INI (.ini). Throws InvalidInputError if the file cannot
/// be read, naming what a YAML file lacks, or the size that a matrix has and must have, and where ToCalibration refuses
/// its camera. All messages name the file.
/// @param rectified of ToCalibration
sensor_msgs::CameraInfo ReadCalibrationFile(const std::string& path, bool rectified = false);

}  // namespace acmp
