#include "acmp_mapping/fill/kernel/fill_grid.h"

#include <tuple>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/fill/fill.h"
#include "fusion/analytic_views.h"

namespace acmp {
namespace {

/// What one source sees of the middle of a wall 5 m away, if its map says so many times the true depth.
ViewSupport LookAtAWallSeenAt(float factor) {
  const std::vector<Quad> wall = {{{-10, -10, 5}, {20, 0, 0}, {0, 20, 0}, {90, 90, 90}}};
  const PinholeCamera camera = {81, 61, 80, 80, 40, 30};
  TestView reference = Render(camera, LookAt({0, 0, 0}, {0, 0, 5}), wall);
  TestView source = Render(camera, LookAt({0.1, 0, 0}, {0.1, 0, 5}), wall);
  for (float& depth : source.depth) depth *= factor;
  FusionSetup<FusionMaps<Vec3f>> setup(CameraOf(reference.View()), MapsOf(reference.View()), ConsistencyLimits(),
                                       RigidTransform::Identity());
  setup.AddSource(CameraOf(source.View()), MapsOf(source.View()));
  return CountSupportingViews(setup.Context(setup.sources().data()), 40, 30);
}

TEST(CountSupportingViewsTest, TellsCloseConfirmationFromConfirmationAndThatFromNearlyOne) {
  // Of depth, 0.2 % are close, 0.3 % confirm, 1.2 % nearly do. A disparity of 1.6 px hardly changes by that.
  for (const float sign : {1.0f, -1.0f}) {
    for (const auto& [off, confirming, closely, nearly] : {std::tuple(0.0f, 1, 1, true),
                                                           {0.0018f, 1, 1, true},
                                                           {0.0022f, 1, 0, true},
                                                           {0.0028f, 1, 0, true},
                                                           {0.0032f, 0, 0, true},
                                                           {0.0115f, 0, 0, true},
                                                           {0.0125f, 0, 0, false}}) {
      const ViewSupport support = LookAtAWallSeenAt(1 + sign * off);
      EXPECT_EQ(ConsistentViews(support), confirming) << sign * off;
      EXPECT_EQ(StrictlyConsistentViews(support), closely) << sign * off;
      EXPECT_EQ(IsLooselyConsistent(support), nearly) << sign * off;
    }
  }
}

}  // namespace
}  // namespace acmp
