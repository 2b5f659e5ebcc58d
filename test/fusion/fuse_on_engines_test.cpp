// Fusion view by view through the engines, in other orders than that of the ranks.

#include <algorithm>
#include <thread>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "fusion/engine_views.h"
#include "fusion/noisy_views.h"
#include "support/devices.h"
#include "support/error_text.h"
#include "support/random_views.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

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

bool HaveCommonFrame(int a, int b) {
  const std::vector<std::vector<int>> neighbors = GroupNeighbors();
  std::vector<int> frames = neighbors[static_cast<size_t>(a)];
  frames.push_back(a);
  const std::vector<int>& others = neighbors[static_cast<size_t>(b)];
  return std::any_of(frames.begin(), frames.end(),
                     [&](int f) { return f == b || std::count(others.begin(), others.end(), f) > 0; });
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

TEST_P(FuseOnEnginesTest, GoesOnElsewhereFromTheFusedPixels) {
  const std::vector<PointCloud> expected = FuseAll(engine_.get(), views_, neighbors_, options_);
  const int count = static_cast<int>(views_.size());
  for (int first_elsewhere : {1, 2, 6}) {
    const auto here = engine_->MakeFusionStamps();
    for (int view = 0; view < first_elsewhere; ++view) Fuse(engine_.get(), view, here.get());
    const auto elsewhere = engine_->MakeFusionStamps();
    for (const EngineView& view : views_) {
      engine_->SetFusedPixels(*view.frame, engine_->FusedPixels(*view.frame, here.get()), elsewhere.get());
    }
    for (int view = first_elsewhere; view < count; ++view) {
      EXPECT_EQ(FirstDifference(Fuse(engine_.get(), view, elsewhere.get()), expected[static_cast<size_t>(view)]), "")
          << view;
    }
  }
  const auto stamps = engine_->MakeFusionStamps();
  EXPECT_THAT(ErrorOf([&] { engine_->SetFusedPixels(*views_[0].frame, Image<unsigned char>(3, 2), stamps.get()); }),
              HasSubstr("fused pixels: 3 x 2 px: must be"));
  EXPECT_THAT(ErrorOf([&] { engine_->FusedPixels(*views_[0].frame, nullptr); }), HasSubstr("stamps: null"));
}

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
      if (std::any_of(left.begin(), next, [&](int earlier) { return HaveCommonFrame(earlier, *next); })) continue;
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

struct ForeignStamps final : FusionStamps {};

TEST_P(FuseOnEnginesTest, RanksOutOfBoundsAndOtherStampsAreRefused) {
  const std::unique_ptr<FusionStamps> stamps = engine_->MakeFusionStamps();
  for (const int rank : {-1, 65535}) {
    EXPECT_THAT(ErrorOf([&] { engine_->FuseView(views_[0], {views_[1]}, {}, rank, stamps.get()); }),
                HasSubstr(Concat("rank of a fused view = ", rank, ": must be in [0, 65534]")));
  }
  EXPECT_NO_THROW(Fuse(engine_.get(), 0, stamps.get())) << "the engine can be used again";
  const auto expect_refused = [&](FusionStamps* bad) {
    EXPECT_THAT(ErrorOf([&] { Fuse(engine_.get(), 0, bad); }), HasSubstr("stamps: null or"));
  };
  ForeignStamps foreign;
  expect_refused(nullptr);
  expect_refused(&foreign);
  std::unique_ptr<DepthEngine> other;
  MakeEngineOrSkip(GetParam() == Device::kCpu ? Device::kCuda : Device::kCpu, &other);
  if (!IsSkipped()) expect_refused(other->MakeFusionStamps().get());
}

}  // namespace
}  // namespace acmp
