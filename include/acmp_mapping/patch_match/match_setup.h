#pragma once

#include <type_traits>
#include <vector>

#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// Projections between the reference and every source view, composed in double and then rounded. Without depths, which
/// depend on the device.
std::vector<SourceView> MakeSourceViews(const PatchMatchProblem& problem);

/// A HalvedDepth in host memory.
struct HalvedDepthMap {
  Image<uint16_t> inverse;  ///< in steps, 0 = unknown
  float step = 0;           ///< 1 / scene unit

  HalvedDepth View() const { return {inverse.View(), step}; }
};

/// The sources' depth maps, halved; what is not positive, infinite or below 1e-30 is unknown, and an empty map gives an
/// empty one.
std::vector<HalvedDepthMap> HalveDepths(const PatchMatchProblem& problem);

/// Number of a pass for its random numbers: 0 photometric, 1 planar prior, 2 + pass geometric.
uint32_t PassNumber(Pass kind, int geometric_pass);

int IterationsOf(Pass kind, const PatchMatchOptions& options);

/// Calls function(pass, method), two std::integral_constants, with the pass and the method that it follows: ACMP's
/// photometric pass is ACMH's, and its planar-prior pass the only one of the papers.
template <class Function>
void VisitPass(Pass kind, Method method, const Function& function) {
  constexpr std::integral_constant<Pass, Pass::kPhotometric> photometric;
  constexpr std::integral_constant<Pass, Pass::kPlanarPrior> planar_prior;
  constexpr std::integral_constant<Pass, Pass::kGeometric> geometric;
  constexpr std::integral_constant<Method, Method::kOurs> ours;
  constexpr std::integral_constant<Method, Method::kAcmh> as_acmh;
  constexpr std::integral_constant<Method, Method::kAcmp> as_acmp;
  const bool is_ours = method == Method::kOurs;
  if (kind == Pass::kPhotometric) return is_ours ? function(photometric, ours) : function(photometric, as_acmh);
  if (kind == Pass::kPlanarPrior) return is_ours ? function(planar_prior, ours) : function(planar_prior, as_acmp);
  if (method == Method::kAcmh) return function(geometric, as_acmh);
  is_ours ? function(geometric, ours) : function(geometric, as_acmp);
}

/// A context without sampler, sources and maps, which depend on the device.
/// @param geometric_pass which one, from 0; of other passes 0
template <class Sampler>
MatchContext<Sampler> MakeMatchContext(const PatchMatchProblem& problem, const PatchMatchOptions& options, Pass kind,
                                       int geometric_pass) {
  const PinholeCamera& camera = problem.reference.camera;
  MatchContext<Sampler> context = {};
  context.num_sources = static_cast<int>(problem.sources.size());
  context.width = camera.width;
  context.height = camera.height;
  context.rays = MakeRayGrid(camera);
  context.depth_min = problem.depth_range.min;
  context.depth_max = problem.depth_range.max;
  context.options = options;
  context.pass_number = PassNumber(kind, geometric_pass);
  return context;
}

}  // namespace acmp
