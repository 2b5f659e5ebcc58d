#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "fusion/engine_views.h"
#include "fusion/noisy_views.h"
#include "fusion/reference_fusion.h"

namespace acmp {
namespace {

TEST(FuseViews, AgreesWithThePlainReference) {
  const std::vector<TestView> views = NoisyViews();
  for (const FusionOptions& options : {PaperFusion(), FusionOptions()}) {
    const PointCloud points = FuseViews(ViewsOf(views), NoisyNeighbors(), options);
    const std::vector<reference::Point> expected = reference::Fuse(ViewsOf(views), NoisyNeighbors(), options);
    ASSERT_EQ(points.size(), expected.size());
    ASSERT_GT(points.size(), 500u);
    for (size_t i = 0; i < points.size(); ++i) reference::ExpectNear(points[i], expected[i]);
  }
}

TEST(FuseViews, UsesNoPixelOfAnEarlierViewsPoints) {
  // Views from one place see the same surface pixel by pixel: one point per pixel, not one per pixel and view.
  const TestView view = FlatView(40, 33, 4);
  const std::vector<FusionView> views(4, view.View());
  for (const int min_views : {0, 2}) {
    const FusionOptions options = PaperFusion(min_views);
    EXPECT_EQ(FuseViews(views, {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}}, options).size(), 40u * 33);
  }
  // The first view uses its only neighbour; the other two then confirm each other.
  EXPECT_EQ(FuseViews(views, {{1}, {0}, {3}, {2}}, PaperFusion(1)).size(), 2u * 40 * 33);
  // A used pixel does not confirm others either: view 2 finds only used ones. By probability it needs none.
  const std::vector<std::vector<int>> all_used = {{1}, {0}, {0, 1}};
  EXPECT_EQ(FuseViews({views[0], views[1], views[2]}, all_used, PaperFusion(1)).size(), 40u * 33);
  EXPECT_EQ(FuseViews({views[0], views[1], views[2]}, all_used, {}).size(), 2u * 40 * 33);
}

TEST(FuseViews, SharesSourcePixelsWithinOneView) {
  // The reference is twice as fine as its source: pairs of its pixels share one source pixel, which goes into the
  // points of both and is used then.
  TestView fine = FlatView(40, 1, 4), coarse = FlatView(20, 1, 4);
  coarse.camera.fx = 50;
  coarse.camera.cx = 9.5;
  EXPECT_EQ(FuseViews({fine.View(), coarse.View()}, {{1}, {0}}, PaperFusion(1)).size(), 40u);
  // The other way about, each coarse pixel uses one fine one; the others have nobody left to confirm them.
  EXPECT_EQ(FuseViews({coarse.View(), fine.View()}, {{1}, {0}}, PaperFusion(1)).size(), 20u);
}

}  // namespace
}  // namespace acmp
