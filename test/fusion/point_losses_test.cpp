// One check is made to fail at a time: it must be the one that is counted.

#include "acmp_mapping/fusion/point_losses.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "acmp_mapping/engine/host_depth_engine.h"
#include "fusion/engine_views.h"

namespace acmp {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

constexpr size_t kPixels = 20 * 16;

/// A wall at 4, seen from three places 0.2 apart: 5 px.
std::vector<TestView> Views() {
  std::vector<TestView> views;
  for (int i = 0; i < 3; ++i) {
    views.push_back(FlatView(20, 16, 4));
    views.back().cam_from_world.translation().x() = -0.02 * i;
  }
  return views;
}

PointLosses Count(const std::vector<TestView>& views, const FusionOptions& options = PaperFusion(), int step = 1) {
  HostDepthEngine engine;
  std::vector<EngineView> sources = UploadViews(views, &engine);
  const EngineView reference = sources.front();
  sources.erase(sources.begin());
  return engine.CountLosses(reference, sources, options, step);
}

TEST(PointLosses, CountsPointsAsTheConsistencyCheckDoes) {
  const std::vector<TestView> views = Views();
  HostDepthEngine engine;
  const ConsistencyResult result = Filter(&engine, ViewsOf(views), PaperFusion());
  const PointLosses losses = Count(views);
  EXPECT_EQ(losses.pixels, kPixels);
  EXPECT_EQ(losses.points, result.points_in_camera.size());
  EXPECT_GT(losses.points, kPixels / 2);
  EXPECT_EQ(losses.points + losses.outside, kPixels) << "the last columns are outside the second source";
  EXPECT_EQ(Count(views, PaperFusion(), 4).pixels, 5u * 4);
}

TEST(PointLosses, NamesTheCheckThatFails) {
  struct Case {
    std::function<void(TestView*, int i)> change;  ///< a source, from 1 on
    size_t PointLosses::*loss;
    std::string description;
  };
  for (const Case& c :
       std::vector<Case>{{[](TestView*v, int) { v->depth = DepthMap(20, 16, 4.2f); },  // 5 %, less than 2 px
                          &PointLosses::relative_depth, "depth (1 %) "},
                         {[](TestView*v, int i) {
                            v->cam_from_world.translation().x() = -0.1 * i;
                            v->depth = DepthMap(20, 16, 2.0f);
                          },
                          &PointLosses::reprojection, "reprojection (2 px)"},
                         {[](TestView*v, int) {
                            v->normal = NormalMap(20, 16, {0.6f, 0, -0.8f});
                          },
                          &PointLosses::angle, "angle of normals (10 degrees)"},
                         {[](TestView*v, int) { v->depth = DepthMap(20, 16, 0.0f); }, &PointLosses::source_depth,
                          "no depth in the other images"}}) {
    std::vector<TestView> views = Views();
    for (int i = 1; i < 3; ++i) c.change(&views[static_cast<size_t>(i)], i);
    const PointLosses losses = Count(views);
    EXPECT_EQ(losses.points, 0u) << c.description;
    EXPECT_GT(losses.*c.loss, kPixels / 4) << c.description;
    EXPECT_THAT(Describe(losses, PaperFusion()), HasSubstr(c.description));
  }
  std::vector<TestView> views = Views();
  views[0].cost = CostMap(20, 16, 2.0f);
  EXPECT_EQ(Count(views).unconfirmed, kPixels);
  views[0].depth = DepthMap(20, 16, 0.0f);
  EXPECT_EQ(Count(views).without_depth, kPixels);
  EXPECT_THAT(Describe(Count(views), {}), AllOf(StartsWith("no depth 100 %"), HasSubstr("~depth_min")));
  views = Views();
  views.resize(1);
  EXPECT_EQ(Count(views).outside, kPixels) << "no source";
}

TEST(PointLosses, TellsWhatLacksConfidence) {
  // Every other three rows are 6 % farther: all is uneven, though the views agree.
  std::vector<TestView> views;
  for (int i = 0; i < 2; ++i) views.push_back(FlatView(20, 16, 4));
  for (TestView& view : views) {
    for (int row = 0; row < 16; ++row) {
      for (int col = 0; col < 20; ++col) view.depth(col, row) *= 1 + 0.06f * static_cast<float>(row / 3 % 2);
    }
  }
  const PointLosses losses = Count(views, {});
  EXPECT_EQ(losses.points + losses.uneven, kPixels);
  EXPECT_GT(losses.uneven, kPixels / 4);
  EXPECT_THAT(Describe(losses, {}), AllOf(StartsWith("confidence (0.35) though views agree "), HasSubstr("uneven")));
  views[0].cost = CostMap(20, 16, kWorstCost);
  EXPECT_EQ(Count(views, {}).unconfirmed, 0u);
  views[0].cost = CostMap(20, 16, kUnsupportedCost);
  EXPECT_EQ(Count(views, {}).unconfirmed, kPixels);
}

}  // namespace
}  // namespace acmp
