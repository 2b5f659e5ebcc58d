#include "acmp_mapping/patch_match/match_setup.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/vector_conversion.h"
#include "acmp_mapping/patch_match/kernel/geometric_cost.h"

namespace acmp {
namespace {

Mat3f ToMat3f(const Eigen::Matrix3d& matrix) {
  Mat3f result;
  for (int i = 0; i < 9; ++i) result.m[i] = static_cast<float>(matrix(i / 3, i % 3));
  return result;
}

}  // namespace

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

HalvedDepthMap HalveDepth(const ImageView<const float>& depth) {
  HalvedDepthMap halved = {Image<uint16_t>(HalvedSize(depth.width), HalvedSize(depth.height)), 0};
  float largest = 0;
  for (int row = 0; row < depth.height; ++row) {
    for (int col = 0; col < depth.width; ++col) largest = std::max(largest, InverseOfDepth(depth(col, row)));
  }
  if (!(largest > 0)) return halved;  // nothing is known
  halved.step = largest / kInverseSteps;
  tbb::parallel_for(0, halved.inverse.height(), [&](int row) {
    for (int col = 0; col < halved.inverse.width(); ++col) {
      halved.inverse(col, row) = StepsOfInverse(HalvedInverseDepth(depth, col, row), halved.step);
    }
  });
  return halved;
}

std::vector<HalvedDepthMap> HalveDepths(const PatchMatchProblem& problem) {
  std::vector<HalvedDepthMap> halved;
  halved.reserve(problem.sources.size());
  for (const MatchView& source : problem.sources) halved.push_back(HalveDepth(source.depth));
  return halved;
}

uint32_t PassNumber(Pass kind, int geometric_pass) {
  if (kind == Pass::kPhotometric) return 0;
  if (kind == Pass::kPlanarPrior) return 1;
  return 2u + static_cast<uint32_t>(geometric_pass);
}

void CheckSize(const char* name, int width, int height, const PinholeCamera& camera) {
  if (width != camera.width || height != camera.height) {
    throw InvalidInputError(
        Concat(name, ": ", width, " x ", height, " px, but the camera has ", camera.width, " x ", camera.height));
  }
}

void CheckStart(const PatchMatchProblem& problem, const EstimateState& start) {
  const PinholeCamera& camera = problem.reference.camera;
  CheckSize("start.planes", start.planes.width(), start.planes.height(), camera);
  CheckSize("start.cost", start.cost.width(), start.cost.height(), camera);
  const RayGrid rays = MakeRayGrid(camera);
  const bool has_mask = !problem.reference.mask_distance.empty();
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const PlaneHypothesis& plane = start.planes(col, row);
      const float depth = PlaneDepth(plane, rays.Ray(static_cast<float>(col), static_cast<float>(row)));
      if (plane.d > 0 && depth > 0 && std::isfinite(depth)) continue;
      if (has_mask && plane.d == 0 && Norm(plane.normal()) == 0) continue;
      throw InvalidInputError(Concat("start.planes: pixel (", col, ", ", row, "): d = ", plane.d, ", depth = ", depth,
                                     ": must both be positive and finite"));
    }
  }
}

}  // namespace acmp
