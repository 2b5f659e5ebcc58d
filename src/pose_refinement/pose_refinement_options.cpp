#include "acmp_mapping/pose_refinement/pose_refinement_options.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

const OptionTable<PoseRefinementOptions>& PoseRefinementOptionTable() {
  static const OptionTable<PoseRefinementOptions> table = [] {
    OptionTable<PoseRefinementOptions> t;
    t.Group("refinement of poses");
    t.Add(
        Choice("refine_poses", {"off", "on", "auto"},
               "Whether received poses are replaced by those of a bundle adjustment over matches between the images; "
               "auto: where matches that took no part then fit clearly better"),
        [](auto& o) -> auto& { return o.refine; });
    return t;
  }();
  return table;
}

void Validate(const PoseRefinementOptions& options) {
  PoseRefinementOptionTable().Check(options);
  CheckRange("corners", options.corners, 50, 5000);
}

}  // namespace acmp
