#include "acmp_mapping/patch_match/match_setup.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/vector_conversion.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"

namespace acmp {
namespace {

void CheckMatchView(const std::string& name, const MatchView& view) {
  CheckCamera(name, view.camera);
  const auto check_size = [&](const char* what, int width, int height) {
    CheckSize(name + ": " + what, width, height, view.camera);
  };
  check_size("image", view.gray.data == nullptr ? 0 : view.gray.width, view.gray.height);
  if (!view.cam_from_world.matrix().allFinite()) throw InvalidInputError(name + ": pose is not finite");
  if (!view.depth.empty()) check_size("depth map", view.depth.width, view.depth.height);
  if (!view.mask_distance.empty()) check_size("mask", view.mask_distance.width, view.mask_distance.height);
}

HalvedDepthMap HalveDepth(const ImageView<const float>& depth) {
  HalvedDepthMap halved = {Image<uint16_t>(HalvedSize(depth.width), HalvedSize(depth.height)), 0};
  float largest = 0;
  for (int row = 0; row < depth.height; ++row) {
    for (int col = 0; col < depth.width; ++col) largest = std::max(largest, InverseOfDepth(depth(col, row)));
  }
  if (!(largest > 0)) return halved;  // nothing is known
  halved.step = largest / kInverseSteps;
  ForEachPixel(halved.inverse.width(), halved.inverse.height(), [&](int col, int row) {
    halved.inverse(col, row) = StepsOfInverse(HalvedInverseDepth(depth, col, row), halved.step);
  });
  return halved;
}

}  // namespace

void Check(const PatchMatchProblem& problem) {
  CheckMatchView("reference view", problem.reference);
  CheckDepthRange("depth range", problem.depth_range);  // before the baselines, which are judged by it
  CheckRange("number of source views", static_cast<int>(problem.sources.size()), 1, kMaxSourceViews);
  const Eigen::Vector3d center = problem.reference.cam_from_world.inverse().translation();
  for (size_t i = 0; i < problem.sources.size(); ++i) {
    const std::string name = Concat("source view ", i);
    CheckMatchView(name, problem.sources[i]);
    const double baseline = (problem.sources[i].cam_from_world.inverse().translation() - center).norm();
    // Below a millionth of the nearest depth the view moves by less than a thousandth of a pixel over the whole range.
    if (!(baseline > 1e-6 * problem.depth_range.min)) {
      throw InvalidInputError(
          Concat(name, ": baseline to the reference = ", baseline, ": must be > 0 for depth to be visible"));
    }
  }
}

std::vector<SourceView> MakeSourceViews(const PatchMatchProblem& problem) {
  const Eigen::Matrix3d k_ref = problem.reference.camera.K();
  const Eigen::Matrix3d k_ref_inverse = k_ref.inverse();
  std::vector<SourceView> views;
  views.reserve(problem.sources.size());
  for (const MatchView& source : problem.sources) {
    const RigidTransform src_from_ref = source.cam_from_world * problem.reference.cam_from_world.inverse();
    const RigidTransform ref_from_src = src_from_ref.inverse();
    const Eigen::Matrix3d k = source.camera.K();
    SourceView view;
    view.a = ToMat3f(k * src_from_ref.linear() * k_ref_inverse);
    view.b = ToVec3f(k * src_from_ref.translation());
    view.back_a = ToMat3f(k_ref * ref_from_src.linear() * k.inverse());
    view.back_b = ToVec3f(k_ref * ref_from_src.translation());
    view.width = static_cast<float>(source.camera.width);
    view.height = static_cast<float>(source.camera.height);
    views.push_back(view);
  }
  return views;
}

std::vector<HalvedDepthMap> HalveDepths(const PatchMatchProblem& problem) {
  std::vector<HalvedDepthMap> halved;
  halved.reserve(problem.sources.size());
  for (const MatchView& source : problem.sources) halved.push_back(HalveDepth(source.depth));
  return halved;
}

int IterationsOf(Pass kind, const PatchMatchOptions& options) {
  if (kind == Pass::kPhotometric) return options.photometric_iterations;
  return kind == Pass::kPlanarPrior ? options.planar_prior_iterations : options.geometric_iterations;
}

uint32_t PassNumber(Pass kind, int geometric_pass) {
  if (kind == Pass::kPhotometric) return 0;
  if (kind == Pass::kPlanarPrior) return 1;
  return 2u + static_cast<uint32_t>(geometric_pass);
}

}  // namespace acmp
