#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "scene_readers.h"

namespace acmp {
namespace {

// Ids and parameter counts of COLMAP's camera models (its documentation, "Camera Models"); 0 parameters: known by name,
// but no Lens has such distortion.
constexpr std::array<ColmapCameraModel, 18> kModels = {{{"SIMPLE_PINHOLE", 0, 1, 3},
                                                        {"PINHOLE", 1, 2, 4},
                                                        {"SIMPLE_RADIAL", 2, 1, 4},
                                                        {"RADIAL", 3, 1, 5},
                                                        {"OPENCV", 4, 2, 8},
                                                        {"OPENCV_FISHEYE", 5, 2, 8},
                                                        {"FULL_OPENCV", 6, 2, 12},
                                                        {"FOV", 7, 0, 0},
                                                        {"SIMPLE_RADIAL_FISHEYE", 8, 1, 4},
                                                        {"RADIAL_FISHEYE", 9, 1, 5},
                                                        {"THIN_PRISM_FISHEYE", 10, 0, 0},
                                                        {"RAD_TAN_THIN_PRISM_FISHEYE", 11, 0, 0},
                                                        {"SIMPLE_DIVISION", 12, 0, 0},
                                                        {"DIVISION", 13, 0, 0},
                                                        {"SIMPLE_FISHEYE", 14, 1, 3},
                                                        {"FISHEYE", 15, 2, 4},
                                                        {"EUCM", 16, 2, 6},
                                                        {"EQUIRECTANGULAR", 17, 0, 2}}};

std::string SupportedNames() {
  std::string names;
  for (const ColmapCameraModel& model : kModels) {
    if (model.parameters > 0) names += (names.empty() ? "" : ", ") + std::string(model.name);
  }
  return names;
}

const ColmapCameraModel& CheckSupported(const std::string& where, const std::string& value,
                                        const ColmapCameraModel* model) {
  if (model != kModels.end() && model->parameters > 0) return *model;
  const std::string known = model != kModels.end() && value != model->name ? Concat(" (", model->name, ")") : "";
  throw InvalidInputError(
      Concat(where, ": camera model ", value, known, " is not supported: must be one of ", SupportedNames()));
}

bool IsFisheye(const std::string& name) { return name.find("FISHEYE") != std::string::npos; }

LensDistortion MakeDistortion(const std::string& name, std::vector<double> coefficients) {
  LensDistortion distortion;
  if (IsFisheye(name)) {
    // Without coefficients this is still an equidistant projection, not a pinhole one.
    coefficients.resize(4, 0.0);
    distortion.model = LensDistortion::Model::kEquidistant;
  } else {
    if (name == "EUCM") return {LensDistortion::Model::kExtendedUnified, std::move(coefficients)};
    const bool none = std::all_of(coefficients.begin(), coefficients.end(), [](double c) { return c == 0; });
    if (none) return distortion;
    distortion.model = name == "FULL_OPENCV" ? LensDistortion::Model::kRational : LensDistortion::Model::kBrownConrady;
    coefficients.resize(std::max<size_t>(coefficients.size(), 4), 0.0);  // p1 = p2 = 0
  }
  distortion.coefficients = std::move(coefficients);
  return distortion;
}

}  // namespace

const ColmapCameraModel& FindColmapCameraModel(const std::string& where, const std::string& name) {
  const auto found =
      std::find_if(kModels.begin(), kModels.end(), [&](const ColmapCameraModel& m) { return m.name == name; });
  return CheckSupported(where, name, found);
}

const ColmapCameraModel& FindColmapCameraModel(const std::string& where, int id) {
  const auto found =
      std::find_if(kModels.begin(), kModels.end(), [&](const ColmapCameraModel& m) { return m.id == id; });
  return CheckSupported(where, Concat("id ", id), found);
}

ColmapCamera MakeColmapCamera(const std::string& where, const ColmapCameraModel& model, int64_t width, int64_t height,
                              const std::vector<double>& parameters) {
  constexpr int64_t kMaxSize = std::numeric_limits<int>::max();
  CheckRange((where + ": image width").c_str(), width, int64_t{1}, kMaxSize);
  CheckRange((where + ": image height").c_str(), height, int64_t{1}, kMaxSize);
  const std::string name = model.name;
  const auto focal_lengths = static_cast<size_t>(model.focal_lengths);
  ColmapCamera result;
  if (name == "EQUIRECTANGULAR") {  // its parameters are the size once more
    const double px_per_rad = static_cast<double>(width) / (360 * kRadPerDeg<double>);
    result.camera = {static_cast<int>(width),
                     static_cast<int>(height),
                     px_per_rad,
                     px_per_rad,
                     0.5 * static_cast<double>(width) - 0.5,
                     0.5 * static_cast<double>(height) - 0.5};
    result.distortion.model = LensDistortion::Model::kEquirectangular;
    CheckLens(where, result.camera, result.distortion);
    return result;
  }
  result.camera = {static_cast<int>(width),       static_cast<int>(height),        parameters[0],
                   parameters[focal_lengths - 1], parameters[focal_lengths] - 0.5, parameters[focal_lengths + 1] - 0.5};
  CheckCamera(where.c_str(), result.camera);
  result.distortion = MakeDistortion(
      name, std::vector<double>(parameters.begin() + static_cast<ptrdiff_t>(focal_lengths) + 2, parameters.end()));
  CheckLens(where, result.camera, result.distortion);
  return result;
}

RigidTransform MakeColmapPose(const std::string& where, const Eigen::Vector4d& quaternion_wxyz,
                              const Eigen::Vector3d& translation) {
  constexpr double kMaxNormError = 1e-3;
  const auto& q = quaternion_wxyz;
  if (!(std::abs(q.norm() - 1) <= kMaxNormError)) {
    throw InvalidInputError(Concat(where, ": quaternion (", q.transpose(), ") has length ", q.norm(),
                                   ": must be 1 within ", kMaxNormError));
  }
  RigidTransform pose = RigidTransform::Identity();
  pose.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  pose.translation() = translation;
  return pose;
}

}  // namespace acmp
