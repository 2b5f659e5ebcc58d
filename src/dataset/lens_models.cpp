#include "acmp_mapping/dataset/lens_models.h"

#include <cctype>

namespace acmp {

const std::vector<LensModel>& LensModels() {
  using Model = LensDistortion::Model;
  static const std::vector<LensModel> models = {
      {Model::kBrownConrady, "plumb_bob", 4, 5, {"plumbbob", "radtan", "radialtangential", "brownconrady"}},
      {Model::kRational, "rational_polynomial", 4, 8, {"rationalpolynomial", "radialtangential8"}},
      {Model::kEquidistant,
       "equidistant",
       4,
       4,
       {"equidistant", "equi", "fisheye", "kannalabrandt", "kannalabrandt4", "kannalabrandt8"}},
      {Model::kUnified, "mei", 5, 5, {"mei", "unified", "omnidirectional", "omni", "omniradtan"}},
      {Model::kExtendedUnified, "eucm", 2, 2, {"eucm", "extendedunified", "enhancedunified"}},
      {Model::kDoubleSphere, "double_sphere", 2, 2, {"doublesphere", "ds"}},
      {Model::kEquirectangular, "equirectangular", 0, 0, {"equirectangular", "spherical"}}};
  return models;
}

const LensModel& LensModelOf(LensDistortion::Model model) {
  for (const LensModel& known : LensModels()) {
    if (known.model == model) return known;
  }
  return LensModels().front();
}

const LensModel* FindLensModel(const std::string& name) {
  std::string plain;
  for (const unsigned char c : name) {
    if (std::isalnum(c)) plain += static_cast<char>(std::tolower(c));
  }
  for (const LensModel& model : LensModels()) {
    for (const char* known : model.names) {
      if (plain == known) return &model;
    }
  }
  return nullptr;
}

}  // namespace acmp
