#pragma once

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "acmp_mapping/reconstruction/stop_request.h"
#include "plan.h"
#include "progress.h"

namespace acmp {

/// --refine-poses: replaces the poses of the images that take part by refined ones, or leaves them as they are, and
/// says which and why. Images are matched against the plan's source views. Reads every image once.
void RefineScenePoses(const ReconstructPlan& plan, const ReconstructOptions& options, const StopRequest& interrupt,
                      Scene* scene, Progress* progress);

}  // namespace acmp
