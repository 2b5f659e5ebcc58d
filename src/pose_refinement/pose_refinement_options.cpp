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

const OptionTable<PoseRefinementOptions>& PoseRefinementOptionTable() {
  static const OptionTable<PoseRefinementOptions> table = [] {
    OptionTable<PoseRefinementOptions> t;
    t.Group("Refinement of poses");
    t.Add(
        Choice("refine_poses", {"off", "on", "auto"},
               "Whether received poses are replaced by those of a bundle adjustment over matches between the images; "
               "auto: where matches that took no part then fit clearly better"),
        [](auto& o) -> auto& { return o.refine; });
    t.Add(
        Number("refine_poses_corners", 50, 5000, "",
               "Points looked for in an image to refine poses, at most; time grows with it"),
        [](auto& o) -> auto& { return o.corners; });
    t.Add(
        Number("refine_poses_gain", 0, 1, "",
               "Share by which the mean of the images' median residuals must fall for poses to be replaced with "
               "refine_poses "
               "auto"),
        [](auto& o) -> auto& { return o.needed_gain; });
    t.Add(
        Number("refine_poses_gain_px", 0, 10, "px", "And by how much at least"),
        [](auto& o) -> auto& { return o.needed_gain_px; });
    return t;
  }();
  return table;
}

void Validate(const PoseRefinementOptions& options) {
  PoseRefinementOptionTable().Check(options);
  if (options.refine == RefinePoses::kOn && !CanRefinePoses()) {
    throw InvalidInputError("refine_poses: this build has no Ceres, without which it cannot be on");
  }
}

}  // namespace acmp
