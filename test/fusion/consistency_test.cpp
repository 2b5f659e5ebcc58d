#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "fusion/analytic_views.h"
#include "fusion/engine_views.h"
#include "fusion/fusion_contexts.h"
#include "fusion/reference_fusion.h"
#include "support/error_text.h"

namespace acmp {
namespace {

const float kInfinity = std::numeric_limits<float>::infinity();
const PinholeCamera kCamera = {80, 60, 90, 92, 39.2, 30.4};
const Quad kWall = {{0, 0, 5}, {9, 0, 3}, {0, 9, 1}, {200, 100, 50}};

std::vector<TestView> WallViews(const std::vector<Quad>& quads = {kWall}) {
  std::vector<TestView> views;
  views.push_back(Render(kCamera, LookAt({0, 0, 0}, {0, 0, 5}), quads));
  views.push_back(Render(kCamera, LookAt({0.8, 0.1, 0}, {0.1, 0, 5}), quads));
  views.push_back(Render(kCamera, LookAt({-0.7, -0.2, 0.3}, {0, 0.1, 5}), quads));
  return views;
}

std::vector<FusionView> SourcesOf(const std::vector<TestView>& views) {
  std::vector<FusionView> all = ViewsOf(views);
  all.erase(all.begin());
  return all;
}

ConsistencyResult Filter(const std::vector<TestView>& views, const FusionOptions& options = PaperFusion()) {
  return FilterByConsistency(views[0].View(), SourcesOf(views), options);
}

Image<unsigned char> CountMatches(const std::vector<TestView>& views, const FusionOptions& options = PaperFusion()) {
  return CountMatches(views[0].View(), SourcesOf(views), options);
}

void ExpectFinite(const PointCloud& points) {
  for (const SurfacePoint& point : points) {
    ASSERT_TRUE(std::isfinite(Norm(point.position)));
    ASSERT_NEAR(Norm(point.normal), 1, 1e-5);
    ASSERT_TRUE(point.confidence >= 0 && point.confidence <= 1);
  }
}

TEST(FilterByConsistency, AgreesWithPlainReferenceOnNoisyMaps) {
  std::vector<TestView> views = WallViews({kWall, {{0.3, 0, 3}, {0.4, 0, 0.1}, {0, 0.5, 0}, {10, 20, 30}}});
  std::mt19937 generator(1);
  std::normal_distribution<float> relative_noise(0, 0.006f), normal_noise(0, 0.06f);
  std::uniform_real_distribution<float> any_cost(0, 1);
  std::uniform_int_distribution<int> any_color(0, 255);
  for (TestView& view : views) {
    for (float& z : view.depth) z *= 1 + relative_noise(generator);
    for (Vec3f& n : view.normal) {
      n = Normalized(n + Vec3f{normal_noise(generator), normal_noise(generator), normal_noise(generator)});
    }
    for (float& c : view.cost) {
      const float any = any_cost(generator);
      c = any < 0.9f ? any : any < 0.95f ? kWorstCost : kUnsupportedCost;
    }
    for (Rgb& rgb : view.color) rgb.g = static_cast<unsigned char>(any_color(generator));
  }
  FusionOptions ours;
  ours.min_confidence = 0.6f;  // decides on many of these pixels
  for (const FusionOptions& options : {PaperFusion(), ours}) {
    const ConsistencyResult result = Filter(views, options);
    const Image<unsigned char> counts = CountMatches(views, options);
    const std::vector<FusionView> all = ViewsOf(views);
    const std::vector<const FusionView*> sources = {&all[1], &all[2]};
    size_t next = 0;
    int pixels_of_count[3] = {0, 0, 0};
    for (int row = 0; row < kCamera.height; ++row) {
      for (int col = 0; col < kCamera.width; ++col) {
        const auto matches = reference::FindMatches(all[0], sources, col, row, options);
        ASSERT_EQ(counts(col, row), matches.size()) << col << ", " << row;
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
    EXPECT_GT(next, 500u);
    EXPECT_LT(next, result.confidence.size() - 500);
    for (const int pixels : pixels_of_count) EXPECT_GT(pixels, 100);  // the noise makes all cases occur
  }
}

TEST(FilterByConsistency, NeverPutsOutNan) {
  std::vector<TestView> views = WallViews();
  const float odd[] = {kNan, kInfinity, -kInfinity, -1.0f, 0.0f, 1e-38f, 1e38f};
  for (size_t i = 0; i < views.size(); ++i) {
    for (int k = 0; k < 7 * 30; ++k) {
      const int index = 17 * k + 5 * static_cast<int>(i);
      views[i].depth.data()[index] = odd[k % 7];
      views[i].cost.data()[(index + 3) % 4800] = odd[k % 7];
      views[i].normal.data()[(index + 6) % 4800] = {odd[k % 7], odd[(k + 1) % 7], 0};
      views[i].normal.data()[(index + 7) % 4800] = {0, 0, 0};
    }
  }
  const ConsistencyResult result = Filter(views);
  ExpectFinite(result.points_in_camera);
  EXPECT_GT(result.points_in_camera.size(), 1000u);
  for (const float c : result.confidence) ASSERT_TRUE(c >= 0 && c <= 1);
  EXPECT_EQ(result.confidence(0, 0), 0);  // NaN depth
  for (const int min_consistent_views : {0, 1}) {
    const FusionOptions loose = {0.05f, min_consistent_views, 2, 0.99f, 180};
    ExpectFinite(Filter(views, loose).points_in_camera);
    ExpectFinite(FuseViews(ViewsOf(views), {{1, 2}, {0, 2}, {0, 1}}, loose));
  }
}

TEST(MatchSum, HoldsAsManySourcesAsTheLimit) {
  const TestView view = FlatView(2, 2, 4);
  const std::vector<FusionView> sources(kMaxFusionSources, view.View());
  EXPECT_EQ(CountMatches(view.View(), sources, PaperFusion())(1, 1), 255);
  EXPECT_EQ(FilterByConsistency(view.View(), sources, PaperFusion()).points_in_camera.size(), 4u);
  // And fusion finds the bits of all of them.
  std::vector<int> neighbors(kMaxFusionSources);
  std::iota(neighbors.begin(), neighbors.end(), 1);
  std::vector<FusionView> views(256, view.View());
  std::vector<std::vector<int>> all(256);
  all[0] = neighbors;
  FusionContexts contexts(views, all, PaperFusion());
  SurfacePoint point;
  ASSERT_TRUE(FusePixel<kMaxFusionSources>(contexts[0], 1, 1, &point));
  for (int i = 0; i < 256; ++i) ASSERT_EQ(contexts.stamp(i, 1, 1), 0) << i;
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

TEST(FilterByConsistency, DoesNotDependOnTheNumberOfThreads) {
  std::vector<ConsistencyResult> results;
  for (const size_t threads : {1, 4}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    results.push_back(Filter(WallViews()));
  }
  EXPECT_TRUE(std::equal(results[0].confidence.begin(), results[0].confidence.end(), results[1].confidence.begin()));
  const PointCloud &a = results[0].points_in_camera, &b = results[1].points_in_camera;
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    ASSERT_TRUE(a[i].position.x == b[i].position.x && a[i].position.y == b[i].position.y &&
                a[i].position.z == b[i].position.z && a[i].normal.x == b[i].normal.x);
  }
}

TEST(MatchSum, KeepsTheReferenceNormalWhenNormalsCancel) {
  const TestView view = FlatView(1, 1, 4);
  const FusionContexts contexts({view.View()}, {{}}, {});
  ReferencePixel pixel;
  ASSERT_TRUE(LoadReferencePixel(contexts[0], 0, 0, &pixel));
  MatchSum<1> sum;
  StartSum(contexts[0].reference, pixel, &sum);
  AddMatch(contexts[0].reference, 0, {0, 0, pixel.homogeneous, {0, 0, 1}, 1}, &sum);
  EXPECT_EQ(Average(contexts[0].geometry, pixel, sum, 1).normal.z, -1);
}

TEST(FilterByConsistency, WorksWithoutSources) {
  TestView view = FlatView(6, 5, 4);
  view.depth(2, 2) = 0;
  for (const bool with_empty_source : {false, true}) {
    std::vector<FusionView> sources;
    if (with_empty_source) sources.emplace_back();
    const ConsistencyResult result = FilterByConsistency(view.View(), sources, PaperFusion());
    EXPECT_TRUE(result.points_in_camera.empty());
    EXPECT_FLOAT_EQ(result.confidence(1, 1), static_cast<float>(1 / (1 + std::exp(-LogOddsOf({}, 0)))));
    EXPECT_EQ(result.confidence(2, 2), 0);
    FusionOptions all;
    all.min_confidence = 0;
    EXPECT_EQ(FilterByConsistency(view.View(), sources, all).points_in_camera.size(), 29u);
  }
  const ConsistencyResult empty = FilterByConsistency(FusionView(), {view.View()}, {});
  EXPECT_TRUE(empty.confidence.empty() && empty.points_in_camera.empty());
}

}  // namespace
}  // namespace acmp
