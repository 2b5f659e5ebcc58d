#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "acmp_mapping/evaluation/synthetic_scene.h"
#include "evaluation/named_scene.h"

namespace acmp {
namespace {

using Eigen::Vector3d;

const std::vector<SyntheticView>& Views() {
  static const std::vector<SyntheticView> kViews = MakeSyntheticScene(NamedScene("street", 240, 160, 6));
  return kViews;
}

Vector3d CentreOf(const SyntheticView& view) { return view.frame.cam_from_world.inverse().translation(); }

TEST(StreetScene, ShowsASkyAboveAndThingsNearAndFarAway) {
  for (const SyntheticView& view : Views()) {
    const DepthMap& depth = view.true_depth;
    const double sky = static_cast<double>(std::count(depth.begin(), depth.end(), 0.0f)) / depth.size();
    EXPECT_GT(sky, 0.10);
    EXPECT_LT(sky, 0.30);
    // Nothing but the road in front of the bumper.
    for (int col = 0; col < depth.width(); ++col) EXPECT_GT(depth(col, depth.height() - 1), 0) << col;
    float nearest = std::numeric_limits<float>::max(), farthest = 0;
    for (const float z : depth) {
      if (z > 0) nearest = std::min(nearest, z);
      farthest = std::max(farthest, z);
    }
    EXPECT_LT(nearest, 5);
    EXPECT_GT(farthest, 45);
  }
}

TEST(StreetScene, SkyHasNoNormalNoLandmarkAndNoPoint) {
  for (const SyntheticView& view : Views()) {
    for (int row = 0; row < view.true_depth.height(); ++row) {
      for (int col = 0; col < view.true_depth.width(); ++col) {
        const Vec3f& normal = view.true_normal(col, row);
        ASSERT_NEAR(Norm(normal), view.true_depth(col, row) > 0 ? 1 : 0, 1e-5) << col << " " << row;
      }
    }
    EXPECT_GT(view.frame.landmarks_in_world.size(), 10u);  // what the choice of source views asks for
    for (const Vector3d& point : view.frame.landmarks_in_world) EXPECT_LT((point - CentreOf(view)).norm(), 100);
  }
  // The box around all is 60 m away at least.
  for (const SurfacePoint& point : SampleSyntheticSurface(Views(), 0.5f)) {
    EXPECT_LT(std::abs(point.position.x), 41);
    EXPECT_LT(point.position.z, 20);
  }
}

TEST(StreetScene, MovesAheadAndBackAgainLookingAhead) {
  const std::vector<SyntheticView> views = MakeSyntheticScene(NamedScene("street", 32, 32, 81));
  for (size_t i = 0; i + 1 < views.size(); ++i) {
    const Vector3d forward = views[i].frame.cam_from_world.linear().row(2);
    EXPECT_GT(forward.y(), 0.99);
    const double step = CentreOf(views[i + 1]).y() - CentreOf(views[i]).y();
    // 45 cm and a sway of at most a fifth of it at either end.
    EXPECT_NEAR(i < 40 ? step : -step, 0.45, 2 * 0.09) << i;
  }
  EXPECT_NEAR(CentreOf(views[80]).y(), CentreOf(views[0]).y(), 2 * 0.09);
}

}  // namespace
}  // namespace acmp
