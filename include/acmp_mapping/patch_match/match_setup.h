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

/// @param depth z; what is not positive, infinite or below 1e-30 is unknown; an empty map gives an empty one
HalvedDepthMap HalveDepth(const ImageView<const float>& depth);

/// The sources' depth maps, halved.
std::vector<HalvedDepthMap> HalveDepths(const PatchMatchProblem& problem);

/// Number of a pass for its random numbers: 0 photometric, 1 planar prior, 2 + pass geometric.
uint32_t PassNumber(Pass kind, int geometric_pass);

/// Calls function(method), a std::integral_constant, with the method that the pass follows: ACMP's photometric pass is
/// ACMH's, and its planar-prior pass the only one of the papers.
template <Pass kPass, class Function>
void VisitMethod(Method method, const Function& function) {
  constexpr bool kHasAcmh = kPass != Pass::kPlanarPrior, kHasAcmp = kPass != Pass::kPhotometric;
  if (method == Method::kOurs) return function(std::integral_constant<Method, Method::kOurs>());
  if constexpr (kHasAcmh) {
    if (method == Method::kAcmh || !kHasAcmp) return function(std::integral_constant<Method, Method::kAcmh>());
  }
  if constexpr (kHasAcmp) function(std::integral_constant<Method, Method::kAcmp>());
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

/// Throws InvalidInputError unless the map called `name` has the camera's size.
void CheckSize(const char* name, int width, int height, const PinholeCamera& camera);
/// Throws InvalidInputError unless `start` has the reference's size and in every pixel a plane in front of the camera,
/// or none where the reference has a mask (as every pass leaves it).
void CheckStart(const PatchMatchProblem& problem, const EstimateState& start);

}  // namespace acmp
