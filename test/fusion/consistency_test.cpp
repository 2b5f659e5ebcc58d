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

TEST(FusionOptions, AreValidatedAtTheirBounds) {
  EXPECT_NO_THROW(Validate(FusionOptions()));
  const auto error = [](float px, float depth, float angle, int views, float confidence = 0) {
    FusionOptions options;
    options.min_confidence = confidence;
    options.max_reprojection_px = px;
    options.max_relative_depth = depth;
    options.max_normal_angle_deg = angle;
    options.min_consistent_views = views;
    return ErrorOf([&] { Validate(options); });
  };
  EXPECT_EQ(error(0.01f, 0.99f, 180, 0), "no error");
  EXPECT_EQ(error(100, 0.001f, 0.1f, 32, 1), "no error");
  EXPECT_THAT(error(0, 0.1f, 10, 2), testing::HasSubstr("max_reprojection_px = 0"));
  EXPECT_THAT(error(kInfinity, 0.1f, 10, 2), testing::HasSubstr("max_reprojection_px"));
  EXPECT_THAT(error(2, 0, 10, 2), testing::HasSubstr("max_relative_depth = 0"));
  EXPECT_THAT(error(2, 1, 10, 2), testing::HasSubstr("max_relative_depth = 1"));
  EXPECT_THAT(error(2, kNan, 10, 2), testing::HasSubstr("max_relative_depth"));
  EXPECT_THAT(error(2, 0.1f, 0, 2), testing::HasSubstr("max_normal_angle_deg = 0"));
  EXPECT_THAT(error(2, 0.1f, 180.1f, 2), testing::HasSubstr("max_normal_angle_deg = 180.1"));
  EXPECT_THAT(error(2, 0.1f, 10, -1), testing::HasSubstr("min_consistent_views = -1"));
  EXPECT_THAT(error(2, 0.1f, 10, 33), testing::HasSubstr("min_consistent_views = 33"));
  EXPECT_THAT(error(2, 0.1f, 10, 2, -0.01f), testing::HasSubstr("min_confidence = -0.01"));
  EXPECT_THAT(error(2, 0.1f, 10, 2, 1.01f), testing::HasSubstr("min_confidence = 1.01"));
  EXPECT_THAT(error(2, 0.1f, 10, 2, kNan), testing::HasSubstr("min_confidence"));
}

TEST(FilterByConsistency, KeepsATruePlaneWhereverTheSourcesSeeIt) {
  const std::vector<TestView> views = WallViews();
  const ConsistencyResult result = Filter(views);
  const Image<unsigned char> counts = CountMatches(views);
  size_t expected_points = 0;
  for (int row = 0; row < kCamera.height; ++row) {
    for (int col = 0; col < kCamera.width; ++col) {
      const Eigen::Vector3d point = reference::PointInWorld(views[0].View(), col, row);
      int in_view = 0;
      for (size_t i = 1; i < views.size(); ++i) {
        in_view += views[i].camera.Contains(views[i].camera.Project(views[i].cam_from_world * point));
      }
      ASSERT_EQ(counts(col, row), in_view) << col << ", " << row;
      expected_points += in_view >= 2;
    }
  }
  EXPECT_EQ(result.points_in_camera.size(), expected_points);
  EXPECT_GT(expected_points, 3000u);
  const Eigen::Vector3d normal = kWall.side_a.cross(kWall.side_b).normalized();
  for (const SurfacePoint& point : result.points_in_camera) {
    // The reference camera is the world; averages of points on a plane lie on it. Depths near 5 round to 2.4e-7.
    const Eigen::Vector3d position(point.position.x, point.position.y, point.position.z);
    ASSERT_NEAR(normal.dot(position - kWall.center), 0, 2e-6);
    ASSERT_NEAR(std::abs(normal.dot(Eigen::Vector3d(point.normal.x, point.normal.y, point.normal.z))), 1, 1e-6);
    ASSERT_LT(point.normal.z, 0);
    ASSERT_TRUE(point.color.r == 200 && point.color.g == 100 && point.color.b == 50);
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

TEST(FilterByConsistency, RemovesAnOutlier) {
  std::vector<TestView> views = WallViews();
  const size_t all_points = Filter(views).points_in_camera.size();
  ASSERT_EQ(CountMatches(views)(40, 30), 2);
  views[0].depth(40, 30) *= 1.05f;
  const ConsistencyResult result = Filter(views);
  EXPECT_EQ(CountMatches(views)(40, 30), 0);
  EXPECT_EQ(result.points_in_camera.size(), all_points - 1);
  EXPECT_GT(result.confidence(40, 30), 0);
  EXPECT_LT(result.confidence(40, 30), result.confidence(41, 30));
}

TEST(FilterByConsistency, DoesNotCountViewsThatSeeAnOccluder) {
  // A box front hides part of the wall from the right camera only.
  const Quad occluder = {{0.9, 0, 2.5}, {0.3, 0, 0}, {0, 0.3, 0}, {0, 0, 255}};
  const std::vector<TestView> views = WallViews({kWall, occluder});
  const ConsistencyResult result = Filter(views);
  const Image<unsigned char> counts = CountMatches(views);
  int hidden = 0;
  for (int row = 0; row < kCamera.height; ++row) {
    for (int col = 0; col < kCamera.width; ++col) {
      const Eigen::Vector3d point = reference::PointInWorld(views[0].View(), col, row);
      const Eigen::Vector3d in_source = views[1].cam_from_world * point;
      const Eigen::Vector2d pixel = kCamera.Project(in_source);
      if (!kCamera.Contains(pixel)) continue;
      const float seen =
          views[1].depth(static_cast<int>(std::round(pixel.x())), static_cast<int>(std::round(pixel.y())));
      if (seen > 0.8 * in_source.z()) continue;
      ++hidden;
      ASSERT_LE(counts(col, row), 1) << col << ", " << row;
    }
  }
  EXPECT_GT(hidden, 50);
  for (const SurfacePoint& point : result.points_in_camera) {
    const bool is_blue = point.color.b == 255;  // no point mixes both surfaces
    ASSERT_TRUE(is_blue || point.color.b == 50);
    ASSERT_EQ(is_blue, point.position.z < 3);
  }
}

TEST(FilterByConsistency, TakesViewsOfDifferentSizes) {
  std::vector<TestView> views = WallViews();
  views[1] = Render(kCamera.Resized(131, 99), views[1].cam_from_world, {kWall});
  views[2] = Render(kCamera.Resized(53, 41), views[2].cam_from_world, {kWall});
  const ConsistencyResult result = Filter(views);
  EXPECT_EQ(result.confidence.width(), 80);
  EXPECT_GT(result.points_in_camera.size(), 3000u);
  const Eigen::Vector3d normal = kWall.side_a.cross(kWall.side_b).normalized();
  for (const SurfacePoint& point : result.points_in_camera) {
    const Eigen::Vector3d position(point.position.x, point.position.y, point.position.z);
    ASSERT_NEAR(normal.dot(position - kWall.center), 0, 2e-6);  // rounding of depths near 5
  }
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

TEST(FilterByConsistency, AveragesTheColorsThereAre) {
  TestView view = FlatView(3, 3, 4), other = FlatView(3, 3, 4);
  view.color = ColorImage(3, 3, {10, 20, 30});
  other.color = ColorImage(3, 3, {13, 22, 255});
  const auto color = [&] {
    return FilterByConsistency(view.View(), {other.View()}, PaperFusion(1)).points_in_camera.at(4).color;
  };
  EXPECT_TRUE(color().r == 12 && color().g == 21 && color().b == 143);  // 11.5 and 142.5 round up
  other.color = ColorImage();
  EXPECT_TRUE(color().r == 10 && color().g == 20 && color().b == 30);
  view.color = ColorImage();
  EXPECT_TRUE(color().r == 0 && color().g == 0 && color().b == 0);
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

TEST(FilterByConsistency, GuessesAreNeitherPointsNorMatchesOfThePapers) {
  TestView reference = FlatView(20, 15, 4), source = FlatView(20, 15, 4);
  ASSERT_EQ(FilterByConsistency(reference.View(), {source.View()}, PaperFusion(1)).points_in_camera.size(), 300u);
  reference.cost(3, 2) = kWorstCost;
  source.cost(7, 5) = kWorstCost;
  source.cost(8, 5) = std::nextafter(kWorstCost, 0.0f);
  EXPECT_EQ(FilterByConsistency(reference.View(), {source.View()}, PaperFusion(1)).points_in_camera.size(), 298u);
  const Image<unsigned char> counts = CountMatches(reference.View(), {source.View()}, PaperFusion(1));
  EXPECT_EQ(counts(3, 2), 1) << "a source may confirm the guess";
  EXPECT_EQ(counts(7, 5), 0);
  EXPECT_EQ(counts(8, 5), 1);
  const PointCloud fused = FuseViews({reference.View(), source.View()}, {{1}, {0}}, PaperFusion(1));
  for (const SurfacePoint& point : fused) {
    const bool guessed = point.position.x == reference.camera.Unproject({3, 2}, 4).cast<float>().x() &&
                         point.position.y == reference.camera.Unproject({3, 2}, 4).cast<float>().y();
    EXPECT_FALSE(guessed);
  }
}

TEST(FilterByConsistency, GuessesMayBePointsAndUnsupportedPixelsNever) {
  TestView reference = FlatView(20, 15, 4), source = FlatView(20, 15, 4.01f);
  reference.cost(3, 2) = source.cost(7, 5) = kWorstCost;
  reference.cost(4, 2) = source.cost(8, 5) = kUnsupportedCost;
  const PointCloud points = FilterByConsistency(reference.View(), {source.View()}, {}).points_in_camera;
  ASSERT_EQ(points.size(), 299u);
  const Image<unsigned char> counts = CountMatches(reference.View(), {source.View()}, {});
  EXPECT_EQ(counts(7, 5), 1);
  EXPECT_EQ(counts(8, 5), 0);
  // Of a depth 0.25 % farther the weight is exp(-0.25).
  const size_t guess = 20 * 5 + 7 - 1, alone = guess + 1;  // the unsupported pixel before them is none
  EXPECT_NEAR(points[guess].position.z, 4 + 0.01 * std::exp(-0.25) / (1 + std::exp(-0.25)), 1e-6);
  EXPECT_EQ(points[alone].position.z, 4);
}

TEST(FilterByConsistency, LeavesOutWhatIsLessProbable) {
  std::vector<TestView> views;
  for (int i = 0; i < 2; ++i) views.push_back(FlatView(20, 15, 4));
  const ConfidenceMap confidence = Filter(views).confidence;
  const auto count = [&](float min_confidence) {
    FusionOptions options;
    options.min_confidence = min_confidence;
    return Filter(views, options).points_in_camera.size();
  };
  EXPECT_EQ(count(0), 300u);
  EXPECT_EQ(count(1), 0u);
  const float greatest = *std::max_element(confidence.begin(), confidence.end());
  EXPECT_GT(count(std::nextafter(greatest, 0.0f)), 0u);
  EXPECT_EQ(count(std::nextafter(greatest, 1.0f)), 0u);
}

}  // namespace
}  // namespace acmp
