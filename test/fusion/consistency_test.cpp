#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "acmp_mapping/fusion/fusion_setup.h"
#include "fusion/engine_views.h"
#include "fusion/noisy_views.h"
#include "fusion/reference_fusion.h"
#include "support/error_text.h"

namespace acmp {
namespace {

std::vector<FusionView> SourcesOf(const std::vector<TestView>& views) {
  std::vector<FusionView> all = ViewsOf(views);
  all.erase(all.begin());
  return all;
}

ConsistencyResult Filter(const std::vector<TestView>& views, const FusionOptions& options = PaperFusion()) {
  return FilterByConsistency(views[0].View(), SourcesOf(views), options);
}

void ExpectFinite(const PointCloud& points) {
  for (const SurfacePoint& point : points) {
    ASSERT_TRUE(std::isfinite(Norm(point.position)));
    ASSERT_NEAR(Norm(point.normal), 1, 1e-5);
    ASSERT_TRUE(point.confidence >= 0 && point.confidence <= 1);
  }
}

TEST(FilterByConsistency, AgreesWithPlainReferenceOnNoisyMaps) {
  std::vector<TestView> views = NoisyViews();
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> any_cost(0, 1);
  for (TestView& view : views) {
    for (float& c : view.cost) {
      const float any = any_cost(generator);
      c = any < 0.9f ? any : any < 0.95f ? kWorstCost : kUnsupportedCost;
    }
  }
  FusionOptions ours;
  ours.min_confidence = 0.6f;  // decides on many of these pixels
  for (const FusionOptions& options : {PaperFusion(), ours}) {
    const ConsistencyResult result = Filter(views, options);
    const std::vector<FusionView> all = ViewsOf(views);
    const std::vector<const FusionView*> sources = {&all[1], &all[2], &all[3]};
    size_t next = 0;
    int pixels_of_count[4] = {};
    for (int row = 0; row < views[0].camera.height; ++row) {
      for (int col = 0; col < views[0].camera.width; ++col) {
        const auto matches = reference::FindMatches(all[0], sources, col, row, options);
        ++pixels_of_count[matches.size()];
        const double confidence = reference::Confidence(all[0], sources, col, row, options);
        ASSERT_NEAR(result.confidence(col, row), confidence, 1e-6);  // float: 6e-8; noise does not amplify it
        if (!reference::Accepts(all[0], col, row, confidence, matches, options)) continue;
        ASSERT_LT(next, result.points_in_camera.size());
        reference::ExpectNear(result.points_in_camera[next++],
                              reference::Average(all[0], sources, col, row, matches, confidence));
      }
    }
    EXPECT_EQ(next, result.points_in_camera.size());
    EXPECT_GT(next, 300u);
    EXPECT_LT(next, result.confidence.size() - 200);
    for (const int pixels : pixels_of_count) EXPECT_GT(pixels, 0);  // the noise makes all cases occur
  }
}

TEST(FilterByConsistency, NeverPutsOutNan) {
  std::vector<TestView> views = NoisyViews();
  SpoilSomePixels(&views);
  const ConsistencyResult result = Filter(views);
  ExpectFinite(result.points_in_camera);
  EXPECT_GT(result.points_in_camera.size(), 300u);
  for (const float c : result.confidence) ASSERT_TRUE(c >= 0 && c <= 1);
  EXPECT_EQ(result.confidence(0, 0), 0);  // NaN depth
  for (const int min_consistent_views : {0, 1}) {
    const FusionOptions loose = {0.05f, min_consistent_views, 2, 0.99f, 180};
    ExpectFinite(Filter(views, loose).points_in_camera);
    ExpectFinite(FuseViews(ViewsOf(views), NoisyNeighbors(), loose));
  }
}

TEST(MatchSum, HoldsAsManySourcesAsTheLimit) {
  const TestView view = FlatView(2, 2, 4);
  const std::vector<FusionView> sources(kMaxFusionSources, view.View());
  EXPECT_EQ(FilterByConsistency(view.View(), sources, PaperFusion(32)).points_in_camera.size(), 4u);
  // And fusion finds the pixels of all of them: none is left for a point of its own.
  const std::vector<FusionView> views(kMaxFusionSources + 1, view.View());
  std::vector<std::vector<int>> neighbors(views.size());
  for (int i = 1; i <= kMaxFusionSources; ++i) neighbors[0].push_back(i);
  EXPECT_EQ(FuseViews(views, neighbors, PaperFusion(0)).size(), 4u);
}

TEST(FilterByConsistency, RefusesBadInput) {
  const TestView good = FlatView(4, 3, 2);
  const auto error = [&](auto&& spoil) {
    TestView bad = FlatView(4, 3, 2);
    spoil(bad);
    std::string as_source = ErrorOf([&] { FilterByConsistency(good.View(), {good.View(), bad.View()}, {}); });
    const std::string as_reference = ErrorOf([&] { FilterByConsistency(bad.View(), {good.View()}, {}); });
    EXPECT_THAT(as_source, testing::HasSubstr("source view 1"));
    EXPECT_THAT(as_reference, testing::HasSubstr("reference view"));
    return as_source;
  };
  EXPECT_THAT(error([](TestView& v) { v.camera.width = 5; }), testing::HasSubstr("depth map is 4 x 3"));
  EXPECT_THAT(error([](TestView& v) { v.normal = NormalMap(3, 3); }), testing::HasSubstr("normal map is 3 x 3"));
  EXPECT_THAT(error([](TestView& v) { v.cost = CostMap(); }), testing::HasSubstr("cost map is 0 x 0"));
  EXPECT_THAT(error([](TestView& v) { v.color = ColorImage(4, 4); }), testing::HasSubstr("colour map is 4 x 4"));
  EXPECT_THAT(error([](TestView& v) { v.camera.fx = 0; }), testing::HasSubstr("fx = 0"));
  EXPECT_THAT(error([](TestView& v) { v.cam_from_world.translation().x() = kNan; }), testing::HasSubstr("rigid"));
  EXPECT_THAT(error([](TestView& v) { v.cam_from_world.linear() *= 1.1; }), testing::HasSubstr("rigid"));
  EXPECT_THAT(error([](TestView& v) { v.cam_from_world.linear()(2, 2) = -1; }), testing::HasSubstr("rigid"));
  const std::vector<FusionView> many(256, good.View());
  EXPECT_THAT(ErrorOf([&] { FilterByConsistency(good.View(), many, {}); }), testing::HasSubstr("256"));
  FusionOptions options;
  options.min_consistent_views = -1;
  EXPECT_THROW(FilterByConsistency(FusionView(), {}, options), InvalidInputError);
}

TEST(MatchSum, KeepsTheReferenceNormalWhenNormalsCancel) {
  std::vector<TestView> views;
  for (const Vec3f& normal : {Vec3f{0, 0, -1}, {0.8660254f, 0, 0.5f}, {-0.8660254f, 0, 0.5f}}) {
    views.push_back(FlatView(1, 1, 4));
    views.back().normal = NormalMap(1, 1, normal);
  }
  const PointCloud points = Filter(views, {0, 2, 2, 0.01f, 130}).points_in_camera;
  ASSERT_EQ(points.size(), 1u);
  EXPECT_EQ(points[0].normal.z, -1);
}

TEST(FilterByConsistency, WorksWithoutSources) {
  TestView view = FlatView(6, 5, 4);
  view.depth(2, 2) = 0;
  for (const bool with_empty_source : {false, true}) {
    std::vector<FusionView> sources;
    if (with_empty_source) sources.emplace_back();
    const ConsistencyResult result = FilterByConsistency(view.View(), sources, PaperFusion());
    EXPECT_TRUE(result.points_in_camera.empty());
    EXPECT_FLOAT_EQ(result.confidence(1, 1), static_cast<float>(1 / (1 + std::exp(7 + 1.74 * std::log(0.01)))));
    EXPECT_EQ(result.confidence(2, 2), 0);
    FusionOptions all;
    all.min_confidence = 0;
    EXPECT_EQ(FilterByConsistency(view.View(), sources, all).points_in_camera.size(), 29u);
  }
  const ConsistencyResult empty = FilterByConsistency(FusionView(), {view.View()}, {});
  EXPECT_TRUE(empty.confidence.empty() && empty.points_in_camera.empty());
}

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
