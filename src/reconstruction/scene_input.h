#pragma once

#include <vector>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "acmp_mapping/reconstruction/stop_request.h"
#include "plan.h"
#include "progress.h"

namespace acmp {

/// Gives the scene's images the masks of --masks, says how many have one, and reads those of `indices` once, so that a
/// bad one is found now. Returns the indices of the images that are of use: a warning names those of which their mask
/// ignores every pixel. Throws InvalidInputError as AddMasks and LoadMask do, and where no image is of use.
std::vector<int> TakeMasks(const ReconstructOptions& options, const std::vector<int>& indices, Scene* scene,
                           Progress* progress);

/// Gives the scene's images the depth maps of --prior-depth and says how many of `indices` have one; a warning names
/// those without any depth. Throws InvalidInputError as AddPriorDepths and ReadPriorDepthOf do.
void TakePriorDepths(const ReconstructOptions& options, const std::vector<int>& indices, Scene* scene,
                     Progress* progress);

/// --refine-poses: replaces the poses of the images that take part by refined ones, or leaves them as they are, and
/// says which and why. Images are matched against the plan's source views. Reads every image once.
void RefineScenePoses(const ReconstructPlan& plan, const ReconstructOptions& options, const StopRequest& interrupt,
                      Scene* scene, Progress* progress);

}  // namespace acmp
