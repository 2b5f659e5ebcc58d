#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/geometry/lens.h"

namespace acmp {

/// What a model of LensDistortion can do, and what files and messages say of it.
struct LensModel {
  LensDistortion::Model model;
  const char* name;                ///< of camera_info; where ROS has none, ours
  size_t least, most;              ///< coefficients
  double largest_field;            ///< deg
  bool can_be_radial;              ///< whether its coefficients can say radial distortion
  std::vector<const char*> names;  ///< that others give it, in small letters and digits alone
};

/// All that have a name: without distortion it is plumb_bob.
const std::vector<LensModel>& LensModels();
const LensModel& LensModelOf(LensDistortion::Model model);
/// By any name, whatever its letters' case and its signs; null where it is not known.
const LensModel* FindLensModel(const std::string& name);

}  // namespace acmp
