// The consistency check and the fusion of all views on every device, against plain references in double.

#include <algorithm>
#include <random>
#include <thread>

#include "fusion/engine_views.h"
#include "fusion/reference_fusion.h"
#include "support/devices.h"
#include "support/error_text.h"
#include "support/random_views.h"

namespace acmp {
namespace {

void ExpectFinite(const PointCloud& points) {
  for (const SurfacePoint& point : points) {
    ASSERT_TRUE(std::isfinite(Norm(point.position)));
    ASSERT_NEAR(Norm(point.normal), 1, 1e-5);
    ASSERT_TRUE(point.confidence >= 0 && point.confidence <= 1);
  }
}

class FusionTest : public EngineTest {
 protected:
  ConsistencyResult Filter(const std::vector<FusionView>& views, const FusionOptions& options = PaperFusion()) {
    return acmp::Filter(engine_.get(), views, options);
  }
  PointCloud Fuse(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                  const FusionOptions& options) {
    return FuseViews(engine_.get(), views, neighbors, options);
  }
};
INSTANTIATE_TEST_SUITE_P(Devices, FusionTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(FusionTest, FilterAgreesWithThePlainReferenceOnNoisyMaps) {
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
  for (const bool has_color : {true, false}) {
    if (!has_color) {
      for (const size_t i : {size_t{0}, size_t{2}}) views[i].color = ColorImage();
    }
    const std::vector<FusionView> all = ViewsOf(views);
    const std::vector<const FusionView*> sources = {&all[1], &all[2], &all[3]};
    const std::vector<EngineView> uploaded = UploadViews(all, engine_.get());
    for (const FusionOptions& options : {PaperFusion(), ours}) {
      const std::vector<EngineView> others(uploaded.begin() + 1, uploaded.end());
      const ConsistencyResult result = engine_->FilterByConsistency(uploaded[0], others, options);
      const ConfidenceMap alone = engine_->MeasureConfidence(uploaded[0], others, options);
      EXPECT_TRUE(std::equal(alone.begin(), alone.end(), result.confidence.begin(), result.confidence.end()));
      size_t next = 0;
      int pixels_of_count[4] = {};
      for (int row = 0; row < views[0].camera.height; ++row) {
        for (int col = 0; col < views[0].camera.width; ++col) {
          const auto matches = reference::FindMatches(all[0], sources, col, row, options);
          ++pixels_of_count[matches.size()];
          const double confidence = reference::Confidence(all[0], sources, col, row);
          ASSERT_NEAR(result.confidence(col, row), confidence, reference::kConfidenceTolerance);
          if (!reference::Accepts(all[0], col, row, confidence, matches, options)) continue;
          ASSERT_LT(next, result.points_in_camera.size());
          const SurfacePoint& point = result.points_in_camera[next++];
          if (has_color) {
            reference::ExpectNear(point, reference::Average(all[0], sources, col, row, matches, confidence));
          }
        }
      }
      EXPECT_EQ(next, result.points_in_camera.size());
      EXPECT_GT(next, 300u);
      EXPECT_LT(next, result.confidence.size() - 200);
      for (const int pixels : pixels_of_count) EXPECT_GT(pixels, 0);  // the noise makes all cases occur
    }
  }
}

TEST_P(FusionTest, DoesNotDependOnHowFarAwayTheWorldsOriginIs) {
  // UTM coordinates: float32 would round them to half a metre.
  const Eigen::Vector3d away(5e5, 5.8e6, 300);
  std::vector<TestView> views = NoisyViews();
  const ConsistencyResult near = Filter(ViewsOf(views), {});
  for (TestView& view : views) view.cam_from_world.translation() -= view.cam_from_world.linear() * away;
  const ConsistencyResult far = Filter(ViewsOf(views), {});
  ASSERT_EQ(near.points_in_camera.size(), far.points_in_camera.size());
  for (size_t i = 0; i < near.confidence.size(); ++i) {
    ASSERT_NEAR(near.confidence.data()[i], far.confidence.data()[i], reference::kConfidenceTolerance);
  }
  for (size_t i = 0; i < near.points_in_camera.size(); ++i) {
    ASSERT_NEAR(near.points_in_camera[i].position.x, far.points_in_camera[i].position.x, 1e-5);
    ASSERT_NEAR(near.points_in_camera[i].position.z, far.points_in_camera[i].position.z, 1e-5);
  }
}

TEST_P(FusionTest, NeverPutsOutNan) {
  std::vector<TestView> views = NoisyViews();
  SpoilSomePixels(&views);
  const ConsistencyResult result = Filter(ViewsOf(views));
  ExpectFinite(result.points_in_camera);
  EXPECT_GT(result.points_in_camera.size(), 300u);
  for (const float c : result.confidence) ASSERT_TRUE(c >= 0 && c <= 1);
  EXPECT_EQ(result.confidence(0, 0), 0);  // NaN depth
  for (const int min_consistent_views : {0, 1}) {
    const FusionOptions loose = {0.05f, min_consistent_views, 2, 0.99f, 180};
    ExpectFinite(Filter(ViewsOf(views), loose).points_in_camera);
    ExpectFinite(Fuse(ViewsOf(views), NoisyNeighbors(), loose));
  }
}

TEST_P(FusionTest, AllSizesGiveThePixelsInTheirOrder) {
  // Around one block of 256 pixels of a GPU, then above 1024 blocks, which its scan takes in several steps.
  std::mt19937 generator(4);
  for (const auto& [width, height] : {std::pair(1, 1), {17, 15}, {16, 16}, {19, 27}, {64, 64}, {640, 480}}) {
    TestView view = FlatView(width, height, 4);
    for (float& z : view.depth) z = generator() % 3 == 0 ? 0.0f : z;
    const std::vector<FusionView> three(3, view.View());
    const PointCloud points = Filter(three).points_in_camera;
    size_t next = 0;
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        if (!(view.depth(col, row) > 0)) continue;
        ASSERT_LT(next, points.size());
        const Eigen::Vector3d expected = view.camera.Unproject({col, row}, 4);
        ASSERT_NEAR(points[next].position.x, expected.x(), 1e-5);
        ASSERT_NEAR(points[next++].position.y, expected.y(), 1e-5);
      }
    }
    EXPECT_EQ(next, points.size());
    EXPECT_EQ(Fuse(three, {{1, 2}, {0, 2}, {0, 1}}, PaperFusion()).size(), next) << "later views find no pixel left";
  }
  const TestView near = FlatView(70, 50, 4), far = FlatView(70, 50, 8);
  EXPECT_TRUE(Filter({near.View(), far.View(), far.View()}).points_in_camera.empty());
}

TEST_P(FusionTest, TakesAsManySourcesAsTheMatcherAndRefusesBadInput) {
  const TestView view = FlatView(2, 2, 4);
  const std::vector<FusionView> views(kMaxFusionSources + 1, view.View());
  EXPECT_EQ(Filter(views, PaperFusion(32)).points_in_camera.size(), 4u);
  // And fusion finds the pixels of all of them: none is left for a point of its own.
  std::vector<std::vector<int>> neighbors(views.size());
  for (int i = 1; i <= kMaxFusionSources; ++i) neighbors[0].push_back(i);
  EXPECT_EQ(Fuse(views, neighbors, PaperFusion(0)).size(), 4u);
  const std::vector<FusionView> too_many(kMaxFusionSources + 2, view.View());
  EXPECT_REFUSED(Filter(too_many), "source views = 33: must be in [0, 32]");
  TestView scaled = FlatView(2, 2, 4);
  scaled.cam_from_world.linear() *= 1.1;
  EXPECT_REFUSED(Filter({scaled.View(), view.View()}), "reference view");
  EXPECT_REFUSED(Filter({view.View(), view.View(), scaled.View()}), "source view 1");
}

TEST_P(FusionTest, KeepsTheReferenceNormalWhenNormalsCancel) {
  std::vector<TestView> views;
  for (const Vec3f& normal : {Vec3f{0, 0, -1}, {0.8660254f, 0, 0.5f}, {-0.8660254f, 0, 0.5f}}) {
    views.push_back(FlatView(1, 1, 4));
    views.back().normal = NormalMap(1, 1, normal);
  }
  const PointCloud points = Filter(ViewsOf(views), {0, 2, 2, 0.01f, 130}).points_in_camera;
  ASSERT_EQ(points.size(), 1u);
  EXPECT_EQ(points[0].normal.z, -1);
}

TEST_P(FusionTest, WorksWithoutSources) {
  TestView view = FlatView(6, 5, 4);
  view.depth(2, 2) = 0;
  for (const bool with_empty_source : {false, true}) {
    std::vector<FusionView> views = {view.View()};
    if (with_empty_source) views.emplace_back();
    const ConsistencyResult result = Filter(views);
    EXPECT_TRUE(result.points_in_camera.empty());
    EXPECT_FLOAT_EQ(result.confidence(1, 1), static_cast<float>(1 / (1 + std::exp(7 + 1.74 * std::log(0.01)))));
    EXPECT_EQ(result.confidence(2, 2), 0);
    FusionOptions all;
    all.min_confidence = 0;
    EXPECT_EQ(Filter(views, all).points_in_camera.size(), 29u);
  }
}

TEST_P(FusionTest, FusionAgreesWithThePlainReference) {
  const std::vector<TestView> views = NoisyViews();
  for (const FusionOptions& options : {PaperFusion(), FusionOptions()}) {
    const PointCloud points = Fuse(ViewsOf(views), NoisyNeighbors(), options);
    const std::vector<reference::Point> expected = reference::Fuse(ViewsOf(views), NoisyNeighbors(), options);
    ASSERT_EQ(points.size(), expected.size());
    ASSERT_GT(points.size(), 500u);
    for (size_t i = 0; i < points.size(); ++i) reference::ExpectNear(points[i], expected[i]);
  }
}

TEST_P(FusionTest, UsesNoPixelOfAnEarlierViewsPoints) {
  // Views from one place see the same surface pixel by pixel: one point per pixel, not one per pixel and view.
  const TestView view = FlatView(40, 33, 4);
  const std::vector<FusionView> views(4, view.View()), three(3, view.View());
  for (const int min_views : {0, 2}) {
    EXPECT_EQ(Fuse(views, {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}}, PaperFusion(min_views)).size(), 40u * 33);
  }
  // The first view uses its only neighbour; the other two then confirm each other.
  EXPECT_EQ(Fuse(views, {{1}, {0}, {3}, {2}}, PaperFusion(1)).size(), 2u * 40 * 33);
  // A used pixel does not confirm others either: view 2 finds only used ones. By probability it needs none.
  const std::vector<std::vector<int>> all_used = {{1}, {0}, {0, 1}};
  EXPECT_EQ(Fuse(three, all_used, PaperFusion(1)).size(), 40u * 33);
  EXPECT_EQ(Fuse(three, all_used, {}).size(), 2u * 40 * 33);
}

TEST_P(FusionTest, SharesSourcePixelsWithinOneView) {
  // The reference is three times as fine as its source: up to nine of its pixels share a source pixel, which goes into
  // the points of all of them and is used then. On a GPU their threads stamp it at once.
  const TestView fine = FlatView(120, 90, 4);
  TestView coarse = FlatView(40, 30, 4);
  coarse.camera = {40, 30, 100.0 / 3, 100.0 / 3, 19.5, 14.5};
  EXPECT_EQ(Fuse({fine.View(), coarse.View()}, {{1}, {0}}, PaperFusion(1)).size(), 120u * 90);
  // The other way about, each coarse pixel uses one fine one; the others have nobody left to confirm them.
  EXPECT_EQ(Fuse({coarse.View(), fine.View()}, {{1}, {0}}, PaperFusion(1)).size(), 40u * 30);
}

// View by view, in other orders than that of the ranks.

/// Two groups of four views that have no frame in common, and one view that has one in common with either.
std::vector<TestView> TwoGroups() {
  std::vector<TestView> views = NoisyViews();
  for (TestView& view : NoisyViews()) views.push_back(std::move(view));
  views.push_back(std::move(NoisyViews()[1]));
  return views;
}

std::vector<std::vector<int>> GroupNeighbors() {
  return {{1, 2, 3}, {0, 2}, {3, 1, 0}, {2, 0, 1}, {5, 6, 7}, {4, 6}, {7, 5, 4}, {6, 4, 5}, {2, 7}};
}

class FuseOnEnginesTest : public EngineTest {
 protected:
  void SetUp() override {
    EngineTest::SetUp();
    if (engine_) views_ = UploadViews(TwoGroups(), engine_.get());
  }
  PointCloud Fuse(DepthEngine* engine, int view, FusionStamps* stamps) const {
    return FuseOne(engine, views_, neighbors_, view, stamps, options_);
  }

  const std::vector<std::vector<int>> neighbors_ = GroupNeighbors();
  const FusionOptions options_ = PaperFusion();  // so strict that of these views each has points of its own
  std::vector<EngineView> views_;
};
INSTANTIATE_TEST_SUITE_P(Devices, FuseOnEnginesTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(FuseOnEnginesTest, ViewsWithoutACommonFrameMayComeInAnyOrder) {
  const std::vector<PointCloud> expected = FuseAll(engine_.get(), views_, neighbors_, options_);
  for (const PointCloud& cloud : expected) ASSERT_GT(cloud.size(), 10u) << "nothing is left: the test shows nothing";
  const int count = static_cast<int>(views_.size());
  for (uint32_t seed = 0; seed < 10; ++seed) {
    TestRandom random(seed);
    const std::unique_ptr<FusionStamps> stamps = engine_->MakeFusionStamps();
    std::vector<PointCloud> clouds(views_.size());
    std::vector<int> left(views_.size());
    for (int i = 0; i < count; ++i) left[static_cast<size_t>(i)] = i;
    bool in_order = true;
    while (!left.empty()) {
      // Any view that has no frame in common with an earlier one that is left.
      const auto next = left.begin() + random.Below(static_cast<int>(left.size()));
      if (std::any_of(left.begin(), next, [&](int earlier) { return HaveCommonFrame(neighbors_, earlier, *next); }))
        continue;
      in_order &= next == left.begin();
      clouds[static_cast<size_t>(*next)] = Fuse(engine_.get(), *next, stamps.get());
      left.erase(next);
    }
    EXPECT_FALSE(in_order) << "seed " << seed << ": the test shows nothing";
    EXPECT_EQ(FirstDifference(clouds, expected), "") << "seed " << seed;
  }
}

TEST_P(FuseOnEnginesTest, EnginesMayFuseAtTheSameTime) {
  const std::vector<PointCloud> expected = FuseAll(engine_.get(), views_, neighbors_, options_);
  const std::unique_ptr<DepthEngine> other = engine_->Share();
  for (int run = 0; run < 10; ++run) {
    const std::unique_ptr<FusionStamps> stamps = engine_->MakeFusionStamps();
    std::vector<PointCloud> clouds(views_.size());
    std::thread second_group([&] {
      for (int i = 4; i < 8; ++i) clouds[static_cast<size_t>(i)] = Fuse(other.get(), i, stamps.get());
    });
    for (int i = 0; i < 4; ++i) clouds[static_cast<size_t>(i)] = Fuse(engine_.get(), i, stamps.get());
    second_group.join();
    clouds[8] = Fuse(engine_.get(), 8, stamps.get());
    ASSERT_EQ(FirstDifference(clouds, expected), "");
  }
}

}  // namespace
}  // namespace acmp
