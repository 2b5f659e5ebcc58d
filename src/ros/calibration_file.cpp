#include "acmp_mapping/ros/input_conversion.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <fstream>
#include <vector>

#include <camera_calibration_parsers/parse_ini.h>
#include <camera_calibration_parsers/parse_yml.h>
#include <yaml-cpp/yaml.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr char kOtherFormats[] =
    "; of the files of VINS, ORB-SLAM, Kalibr and others, rosrun acmp_mapping convert_calibration.py makes one";
constexpr int kMaxCoefficients = 14;  // the most of any model of CameraInfo

/// @param rows, cols that the matrix must have; 0: those of distortion coefficients, of which models have some
void CheckMatrix(const YAML::Node& file, const char* name, int rows, int cols) {
  const YAML::Node node = file[name];
  if (!node) throw InvalidInputError(Concat(name, " is missing", kOtherFormats));
  if (!node.IsMap()) throw InvalidInputError(Concat(name, ": must have rows, cols and data"));
  for (const char* key : {"rows", "cols"}) {
    if (!node[key]) throw InvalidInputError(Concat(name, ".", key, " is missing"));
  }
  const YAML::Node data = node["data"];
  if (!data || !data.IsSequence()) throw InvalidInputError(Concat(name, ".data: must be a list of numbers"));
  for (const YAML::Node& number : data) number.as<double>();  // throws YAML::Exception with line and column
  const int has_rows = node["rows"].as<int>(), has_cols = node["cols"].as<int>();
  const auto fits = [&](int size) { return size >= 0 && size <= kMaxCoefficients; };
  const bool right =
      rows > 0 ? has_rows == rows && has_cols == cols : fits(has_rows) && fits(has_cols) && fits(has_rows * has_cols);
  if (right && data.size() == static_cast<size_t>(has_rows * has_cols)) return;
  throw InvalidInputError(Concat(name, " has ", has_rows, " rows, ", has_cols, " cols and ", data.size(),
                                 " numbers: must have ",
                                 rows > 0 ? Concat(rows, ", ", cols, " and ", rows * cols)
                                          : Concat("at most ", kMaxCoefficients, " numbers, rows x cols of them")));
}

/// camera_calibration_parsers ends the process for matrices of another size, and takes memory for as many coefficients
/// as rows and cols announce.
void CheckYaml(const YAML::Node& file) {
  for (const char* name : {"image_width", "image_height"}) {
    if (!file[name]) throw InvalidInputError(Concat(name, " is missing", kOtherFormats));
    CheckRange(name, file[name].as<int>(), 1, 1000000);
  }
  CheckMatrix(file, "camera_matrix", 3, 3);
  CheckMatrix(file, "rectification_matrix", 3, 3);
  CheckMatrix(file, "projection_matrix", 3, 4);
  CheckMatrix(file, "distortion_coefficients", 0, 0);
}

/// Of a message as `rostopic echo` prints it.
sensor_msgs::CameraInfo ReadMessage(const YAML::Node& file) {
  const auto field = [&](const char* name) {
    if (!file[name]) throw InvalidInputError(Concat(name, " is missing, as a message of camera_info has it"));
    return file[name];
  };
  const auto number = [](const YAML::Node& node) { return node.as<uint32_t>(); };
  const auto read_matrix = [&](const char* name, auto* matrix) {
    const auto values = field(name).as<std::vector<double>>();
    if (values.size() != matrix->size()) {
      throw InvalidInputError(Concat(name, " has ", values.size(), " numbers: must have ", matrix->size()));
    }
    std::copy(values.begin(), values.end(), matrix->begin());
  };
  sensor_msgs::CameraInfo info;
  info.width = number(field("width")), info.height = number(field("height"));
  info.distortion_model = field("distortion_model").as<std::string>();
  info.D = field("D").as<std::vector<double>>();
  read_matrix("K", &info.K), read_matrix("R", &info.R), read_matrix("P", &info.P);
  if (file["binning_x"]) info.binning_x = number(file["binning_x"]);
  if (file["binning_y"]) info.binning_y = number(file["binning_y"]);
  if (const YAML::Node roi = file["roi"]; roi && roi["width"]) {
    info.roi.x_offset = number(roi["x_offset"]), info.roi.y_offset = number(roi["y_offset"]);
    info.roi.width = number(roi["width"]), info.roi.height = number(roi["height"]);
  }
  return info;
}

/// An INI of camera_calibration, whatever its name: ost.txt, camera.ini.
bool IsIni(const std::string& path) {
  constexpr int kLines = 20;  // comments and blank lines before
  std::ifstream stream(path);
  std::string line;
  for (int i = 0; i < kLines && std::getline(stream, line); ++i) {
    if (line.compare(0, 7, "[image]") == 0) return true;
  }
  return false;
}

sensor_msgs::CameraInfo ReadFile(const std::string& path) {
  std::string camera_name;
  sensor_msgs::CameraInfo info;
  if (IsIni(path)) {
    if (camera_calibration_parsers::readCalibrationIni(path, camera_name, info)) return info;
    throw InvalidInputError("is no whole INI of camera_calibration");
  }
  const YAML::Node file = YAML::LoadFile(path);  // the first document
  if (!file.IsMap()) throw InvalidInputError(Concat("must be a map of names and values", kOtherFormats));
  if (file["K"] && file["D"] && !file["camera_matrix"]) return ReadMessage(file);
  CheckYaml(file);
  if (camera_calibration_parsers::readCalibrationYml(path, camera_name, info)) return info;
  throw InvalidInputError(Concat("is no YAML of camera_calibration", kOtherFormats));
}

}  // namespace

void ReadSmallFile(const char* parameter, const std::string& path, const std::function<void()>& read) {
  const std::string what = Concat(parameter, " = \"", path, "\": ");
  if (!std::filesystem::exists(path)) throw InvalidInputError(what + "there is no such file");
  if (!std::filesystem::is_regular_file(path)) throw InvalidInputError(what + "must be a file");  // a pipe never ends
  constexpr uintmax_t kMaxBytes = 1 << 20;  // the parsers take memory for what the file says
  const uintmax_t bytes = std::filesystem::file_size(path);
  if (bytes > kMaxBytes) throw InvalidInputError(Concat(what, "has ", bytes, " bytes: at most ", kMaxBytes));
  try {
    read();
  } catch (const std::exception& error) {  // of YAML, too
    throw InvalidInputError(what + error.what());
  }
}

sensor_msgs::CameraInfo ReadCalibrationFile(const std::string& path, bool rectified) {
  sensor_msgs::CameraInfo info;
  ReadSmallFile("calibration_file", path, [&] {
    info = ReadFile(path);
    ToCalibration(info, rectified);
  });
  return info;
}

}  // namespace acmp
