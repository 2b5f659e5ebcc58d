#include "acmp_mapping/pose_refinement/pose_refinement_options.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

bool CanRefinePoses() {
#ifdef ACMP_HAVE_CERES
  return true;
#else
  return false;
#endif
}

OptionList OptionsOf(PoseRefinementOptions* options) {
  OptionList list;
  list.Group("refinement of poses");
  list.Choice("refine_poses", &options->refine, {"off", "on", "auto"},
              "Whether received poses are replaced by those of a bundle adjustment over matches between the images; "
              "auto: where matches that took no part then fit clearly better");
  return list;
}

void Validate(const PoseRefinementOptions& options) {
  CheckRange("corners", options.corners, 50, 5000);
  if (options.refine == RefinePoses::kOn && !CanRefinePoses()) {
    throw InvalidInputError("refine_poses: this build has no Ceres, without which it cannot be on");
  }
}

}  // namespace acmp
