#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/lens_models.h"
#include "scene_readers.h"

namespace acmp {
namespace {

using Model = LensDistortion::Model;

// COLMAP's camera models (its documentation, "Camera Models"): ids, focal lengths, parameters, and the lens they are
// here. 0 parameters: known by name, but no Lens has such distortion.
constexpr std::array<ColmapCameraModel, 18> kModels = {{{"SIMPLE_PINHOLE", 0, 1, 3, Model::kNone},
                                                        {"PINHOLE", 1, 2, 4, Model::kNone},
                                                        {"SIMPLE_RADIAL", 2, 1, 4, Model::kBrownConrady},
                                                        {"RADIAL", 3, 1, 5, Model::kBrownConrady},
                                                        {"OPENCV", 4, 2, 8, Model::kBrownConrady},
                                                        {"OPENCV_FISHEYE", 5, 2, 8, Model::kEquidistant},
                                                        {"FULL_OPENCV", 6, 2, 12, Model::kRational},
                                                        {"FOV", 7, 0, 0, Model::kNone},
                                                        {"SIMPLE_RADIAL_FISHEYE", 8, 1, 4, Model::kEquidistant},
                                                        {"RADIAL_FISHEYE", 9, 1, 5, Model::kEquidistant},
                                                        {"THIN_PRISM_FISHEYE", 10, 0, 0, Model::kNone},
                                                        {"RAD_TAN_THIN_PRISM_FISHEYE", 11, 0, 0, Model::kNone},
                                                        {"SIMPLE_DIVISION", 12, 0, 0, Model::kNone},
                                                        {"DIVISION", 13, 0, 0, Model::kNone},
                                                        {"SIMPLE_FISHEYE", 14, 1, 3, Model::kEquidistant},
                                                        {"FISHEYE", 15, 2, 4, Model::kEquidistant},
                                                        {"EUCM", 16, 2, 6, Model::kExtendedUnified},
                                                        {"EQUIRECTANGULAR", 17, 0, 2, Model::kEquirectangular}}};

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

LensDistortion MakeDistortion(Model model, std::vector<double> coefficients) {
  const bool is_plane = model == Model::kNone || model == Model::kBrownConrady || model == Model::kRational;
  if (is_plane && std::all_of(coefficients.begin(), coefficients.end(), [](double c) { return c == 0; })) return {};
  // Without coefficients a fisheye is still an equidistant projection, not a pinhole one.
  coefficients.resize(std::max(coefficients.size(), LensModelOf(model).least), 0.0);
  return {model, std::move(coefficients)};
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
  const auto focal_lengths = static_cast<size_t>(model.focal_lengths);
  ColmapCamera result;
  if (model.model == Model::kEquirectangular) {  // its parameters are the size once more
    const double px_per_rad = static_cast<double>(width) / (360 * kRadPerDeg<double>);
    result.camera = {static_cast<int>(width),
                     static_cast<int>(height),
                     px_per_rad,
                     px_per_rad,
                     0.5 * static_cast<double>(width) - 0.5,
                     0.5 * static_cast<double>(height) - 0.5};
    result.distortion.model = model.model;
    CheckLens(where, result.camera, result.distortion);
    return result;
  }
  result.camera = {static_cast<int>(width),       static_cast<int>(height),        parameters[0],
                   parameters[focal_lengths - 1], parameters[focal_lengths] - 0.5, parameters[focal_lengths + 1] - 0.5};
  CheckCamera(where.c_str(), result.camera);
  result.distortion = MakeDistortion(
      model.model,
      std::vector<double>(parameters.begin() + static_cast<ptrdiff_t>(focal_lengths) + 2, parameters.end()));
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
