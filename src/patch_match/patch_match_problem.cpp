#include "acmp_mapping/patch_match/patch_match_problem.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/patch_match_options.h"

namespace acmp {
namespace {

void CheckView(const std::string& name, const MatchView& view) {
  CheckCamera(name.c_str(), view.camera);
  if (view.gray.width != view.camera.width || view.gray.height != view.camera.height || view.gray.data == nullptr) {
    throw InvalidInputError(Concat(name, ": image of ", view.gray.width, " x ", view.gray.height,
                                   " px, but the camera has ", view.camera.width, " x ", view.camera.height));
  }
  if (!view.cam_from_world.matrix().allFinite()) throw InvalidInputError(name + ": pose is not finite");
  if (!view.depth.empty() && (view.depth.width != view.gray.width || view.depth.height != view.gray.height)) {
    throw InvalidInputError(Concat(name, ": depth map of ", view.depth.width, " x ", view.depth.height,
                                   " px for an image of ", view.gray.width, " x ", view.gray.height));
  }
  if (!view.clearance.empty() &&
      (view.clearance.width != view.gray.width || view.clearance.height != view.gray.height)) {
    throw InvalidInputError(Concat(name, ": mask of ", view.clearance.width, " x ", view.clearance.height,
                                   " px for an image of ", view.gray.width, " x ", view.gray.height));
  }
}

}  // namespace

void Check(const PatchMatchProblem& problem) {
  CheckView("reference view", problem.reference);
  CheckDepthRange("depth range", problem.depth_range);  // before the baselines, which are judged by it
  CheckRange("number of source views", static_cast<int>(problem.sources.size()), 1, kMaxSourceViews);
  const Eigen::Vector3d center = problem.reference.cam_from_world.inverse().translation();
  for (size_t i = 0; i < problem.sources.size(); ++i) {
    const std::string name = Concat("source view ", i);
    CheckView(name, problem.sources[i]);
    const double baseline = (problem.sources[i].cam_from_world.inverse().translation() - center).norm();
    // Below a millionth of the nearest depth the view moves by less than a thousandth of a pixel over the whole range.
    if (!(baseline > 1e-6 * problem.depth_range.min)) {
      throw InvalidInputError(
          Concat(name, ": baseline to the reference = ", baseline, ": must be > 0 for depth to be visible"));
    }
  }
}

}  // namespace acmp
