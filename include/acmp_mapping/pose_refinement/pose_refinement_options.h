#pragma once

#include "acmp_mapping/common/option.h"

namespace acmp {

/// Whether received poses are replaced by refined ones.
enum class RefinePoses {
  kOff,
  kOn,    ///< always, where there are enough matches
  kAuto,  ///< where matches that took no part then fit clearly better; otherwise poses stay as they are, bit by bit
};

struct PoseRefinementOptions {
  RefinePoses refine = RefinePoses::kAuto;
  int corners = 250;             ///< landmarks looked for in an image, at most; 50..5000
  double needed_gain = 0.2;      ///< auto: the mean of the images' median residuals must fall by this share ...
  double needed_gain_px = 0.05;  ///< ... and by so many px
};
/// Throws InvalidInputError naming the first field out of bounds, and where poses are to be refined by a build without
/// Ceres.
void Validate(const PoseRefinementOptions& options);

/// False in a build without Ceres.
bool CanRefinePoses();

const OptionTable<PoseRefinementOptions>& PoseRefinementOptionTable();

}  // namespace acmp
