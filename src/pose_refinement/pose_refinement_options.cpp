#include "acmp_mapping/pose_refinement/pose_refinement_options.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

OptionList OptionsOf(PoseRefinementOptions* options) {
  OptionList list;
  list.Group("refinement of poses");
  list.Choice("refine_poses", &options->refine, {"off", "on", "auto"},
              "Whether received poses are replaced by those of a bundle adjustment over matches between the images; "
              "auto: where matches that took no part then fit clearly better, or where an adjustment that took the "
              "camera for an ideal one has bent received poses");
  return list;
}

void Validate(const PoseRefinementOptions& options) { CheckRange("corners", options.corners, 50, 5000); }

}  // namespace acmp
