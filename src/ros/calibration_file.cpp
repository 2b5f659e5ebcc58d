#include "acmp_mapping/ros/input_conversion.h"

#include <exception>
#include <filesystem>
#include <tuple>

#include <camera_calibration_parsers/parse.h>
#include <yaml-cpp/yaml.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"

namespace acmp {
namespace {

constexpr char kOtherFormats[] =
    "; of the files of VINS, ORB-SLAM, Kalibr and others, rosrun acmp_mapping convert_calibration.py makes one";
constexpr int kMaxCoefficients = 14;  // the most of any model of CameraInfo

/// One matrix of the file, of some name; `found` is what the name has.
class MatrixNode {
 public:
  MatrixNode(const YAML::Node& file, const char* name) : name_(name), node_(file[name]) {
    if (!node_) throw InvalidInputError(Concat(name_, " is missing", kOtherFormats));
    if (!node_.IsMap()) throw InvalidInputError(Concat(name_, ": must have rows, cols and data"));
    rows = Number("rows");
    cols = Number("cols");
    const YAML::Node data = node_["data"];
    if (!data || !data.IsSequence()) throw InvalidInputError(Concat(name_, ".data: must be a list of numbers"));
    for (const YAML::Node& number : data) number.as<double>();  // throws YAML::Exception with line and column
    numbers = data.size();
  }

  [[noreturn]] void Refuse(const std::string& expected) const {
    throw InvalidInputError(
        Concat(name_, " has ", rows, " rows, ", cols, " cols and ", numbers, " numbers: must have ", expected));
  }

  int rows, cols;
  size_t numbers;

 private:
  int Number(const char* key) const {
    if (!node_[key]) throw InvalidInputError(Concat(name_, ".", key, " is missing"));
    return node_[key].as<int>();
  }

  const char* name_;
  const YAML::Node node_;
};

/// camera_calibration_parsers ends the process for matrices of another size, and takes memory for as many coefficients
/// as rows and cols announce.
void CheckYaml(const std::string& path) {
  const YAML::Node file = YAML::LoadFile(path);
  if (!file.IsMap()) throw InvalidInputError("must be a map of names and values");
  for (const char* name : {"image_width", "image_height"}) {
    if (!file[name]) throw InvalidInputError(Concat(name, " is missing", kOtherFormats));
    CheckRange(name, file[name].as<int>(), 1, 1000000);
  }
  const std::tuple<const char*, int, int> sizes[] = {
      {"camera_matrix", 3, 3}, {"rectification_matrix", 3, 3}, {"projection_matrix", 3, 4}};
  for (const auto& [name, rows, cols] : sizes) {
    const MatrixNode matrix(file, name);
    const auto numbers = static_cast<size_t>(rows * cols);
    if (matrix.rows != rows || matrix.cols != cols || matrix.numbers != numbers) {
      matrix.Refuse(Concat(rows, ", ", cols, " and ", numbers));
    }
  }
  const MatrixNode distortion(file, "distortion_coefficients");
  const int rows = distortion.rows, cols = distortion.cols;
  const bool small = rows >= 0 && rows <= kMaxCoefficients && cols >= 0 && cols <= kMaxCoefficients;
  if (!small || rows * cols > kMaxCoefficients || distortion.numbers != static_cast<size_t>(rows * cols)) {
    distortion.Refuse(Concat("at most ", kMaxCoefficients, " numbers, rows x cols of them"));
  }
}

}  // namespace

sensor_msgs::CameraInfo ReadCalibrationFile(const std::string& path, bool rectified) {
  const std::string what = Concat("calibration_file = \"", path, "\": ");
  if (!std::filesystem::exists(path)) throw InvalidInputError(what + "there is no such file");
  if (!std::filesystem::is_regular_file(path)) throw InvalidInputError(what + "must be a file");  // a pipe never ends
  std::string camera_name;
  sensor_msgs::CameraInfo info;
  bool read = false;
  try {
    const std::string extension = LowerExtension(path);
    if (extension == ".yaml" || extension == ".yml") CheckYaml(path);
    read = camera_calibration_parsers::readCalibration(path, camera_name, info);
  } catch (const std::exception& error) {
    throw InvalidInputError(what + error.what());
  }
  if (!read) {
    throw InvalidInputError(what + "must be a .yaml, .yml or .ini file as camera_calibration writes them");
  }
  try {
    ToCalibration(info, rectified);
  } catch (const InvalidInputError& error) {
    throw InvalidInputError(what + error.what());
  }
  return info;
}

}  // namespace acmp
