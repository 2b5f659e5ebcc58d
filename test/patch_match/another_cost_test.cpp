#include <algorithm>
#include <cmath>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/host_passes.h"
#include "support/planar_scene.h"

// The passes of the CPU, compiled with the matching cost in another_cost/ instead of the method's.

namespace acmp {
namespace {

constexpr DepthRange kRange = {1, 10};

/// Of the depths after a photometric pass. @param brighter grey levels that the source views have more
double MedianRelativeError(float brighter) {
  std::vector<PlanarView> views = RenderPlanarScene(WorldPlane::Slanted(10, 20, 4), 120, 90, 4);
  for (size_t i = 1; i < views.size(); ++i) {
    for (float& gray : views[i].gray) gray += brighter;
  }
  const EstimateState state = RunPass(MakeProblem(views, 0, kRange), {}, Pass::kPhotometric, {}, {}, 0);
  const DepthMap depth = ToDepthMap(state.planes, views[0].camera);
  std::vector<double> errors;
  for (size_t i = 0; i < depth.size(); ++i) errors.push_back(std::abs(depth.data()[i] / views[0].depth.data()[i] - 1));
  std::nth_element(errors.begin(), errors.begin() + static_cast<long>(errors.size() / 2), errors.end());
  return errors[errors.size() / 2];
}

TEST(AnotherCostTest, AnotherHeaderIsAllThatThePassesNeed) {
  EXPECT_LT(MedianRelativeError(0), 0.01);
  EXPECT_GT(MedianRelativeError(60), 0.05);  // Ncc would not notice
}

}  // namespace
}  // namespace acmp
