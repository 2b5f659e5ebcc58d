#pragma once

#include "acmp_mapping/common/option.h"

namespace acmp {

/// Whether received poses are replaced by refined ones.
enum class RefinePoses {
  kOff,
  kOn,    ///< always, where there are enough matches
  kAuto,  ///< where matches that took no part then fit clearly better, or where received poses are bent; otherwise they
          ///< stay, bit by bit
};

struct PoseRefinementOptions {
  RefinePoses refine = RefinePoses::kAuto;
  int corners = 250;  ///< landmarks looked for in an image, at most; 50..5000
};
/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const PoseRefinementOptions& options);

OptionList OptionsOf(PoseRefinementOptions* options);

}  // namespace acmp
