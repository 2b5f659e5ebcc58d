// What goes from one GPU to another: estimates, and the stamps of the fusion. Also between two engines that have the
// first GPU's memory each for themselves, so that copying is tested where there is one GPU.

#include <memory>
#include <vector>

#include "fusion/engine_views.h"
#include "support/devices.h"
#include "support/error_text.h"
#include "support/pass_result.h"

namespace acmp {
namespace {

/// The engine of GPU 0 and one of GPU `GetParam()` that does not share its memory.
class SeveralGpusTest : public ::testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    try {
      first_ = MakeDepthEngine(Device::kCuda, 0).engine;
      second_ = MakeDepthEngine(Device::kCuda, GetParam()).engine;
    } catch (const InvalidInputError& error) {
      GTEST_SKIP() << "needs " << GetParam() + 1 << " GPUs: " << error.what();
    }
  }

  /// The first engine's estimates for the second.
  std::vector<EngineView> Imported(const std::vector<EngineView>& views) {
    std::vector<EngineView> imported;
    for (const EngineView& view : views) {
      imported.push_back({view.frame, second_->Load(view.frame, 0), second_->Import(view.estimate)});
    }
    return imported;
  }

  std::unique_ptr<DepthEngine> first_, second_;
};
INSTANTIATE_TEST_SUITE_P(SecondGpu, SeveralGpusTest, ::testing::Values(0, 1));

TEST_P(SeveralGpusTest, AnImportedEstimateHasTheSameBits) {
  for (const EngineView& view : UploadViews(NoisyViews(), first_.get())) {
    const EngineEstimatePtr imported = second_->Import(view.estimate);
    EXPECT_TRUE(SameBits(second_->DownloadState(imported), first_->DownloadState(view.estimate)));
    const EstimateMaps copy = second_->Download(imported), original = first_->Download(view.estimate);
    EXPECT_TRUE(SamePixels(copy.depth, original.depth));
    EXPECT_TRUE(SamePixels(copy.normal, original.normal));
    EXPECT_TRUE(SamePixels(copy.cost, original.cost));
  }
}

TEST_P(SeveralGpusTest, GeometricPassesReadImportedEstimatesAsTheirOwn) {
  const std::vector<EngineView> own = UploadViews(NoisyViews(), first_.get()), imported = Imported(own);
  const auto refine = [](DepthEngine* engine, const std::vector<EngineView>& views) {
    EngineProblem problem;
    problem.reference = views[0];
    problem.sources.assign(views.begin() + 1, views.end());
    problem.depth_range = {1, 20};
    return engine->DownloadState(engine->RunGeometric(problem, {}, views[0].estimate, 0));
  };
  EXPECT_TRUE(SameBits(refine(second_.get(), imported), refine(first_.get(), own)));
}

TEST_P(SeveralGpusTest, AnImportedEstimateOutlivesTheOriginal) {
  EngineEstimatePtr imported;
  EstimateState expected;
  {
    const std::unique_ptr<DepthEngine> gone = MakeDepthEngine(Device::kCuda, 0).engine;
    const EngineEstimatePtr original = UploadViews(NoisyViews(), gone.get())[1].estimate;
    expected = gone->DownloadState(original);
    imported = second_->Import(original);
  }
  EXPECT_TRUE(SameBits(second_->DownloadState(imported), expected));
}

TEST_P(SeveralGpusTest, OnlyImportTakesEstimatesOfAnother) {
  const EngineEstimatePtr original = UploadViews(NoisyViews(), first_.get())[0].estimate;
  EXPECT_THROW(second_->Download(original), InvalidInputError);
  EXPECT_EQ(first_->Import(original), original) << "its own is not copied";
  EXPECT_EQ(first_->Share()->Import(original), original);
  EXPECT_REFUSED(second_->Import(nullptr), "null");
  const std::unique_ptr<DepthEngine> cpu = MakeDepthEngine(Device::kCpu).engine;
  const EngineEstimatePtr on_host = UploadViews(NoisyViews(), cpu.get())[0].estimate;
  EXPECT_REFUSED(second_->Import(on_host), "not of a GPU");
  EXPECT_NO_THROW(second_->Import(original)) << "the engine can be used again";
}

TEST_P(SeveralGpusTest, StampsGoToWhereAViewIsFused) {
  const std::vector<EngineView> views = UploadViews(NoisyViews(), first_.get()), others = Imported(views);
  const FusionOptions options = PaperFusion();  // the default takes more of the last view into the points of others
  const std::vector<PointCloud> expected = FuseAll(first_.get(), views, NoisyNeighbors(), options);
  ASSERT_GT(expected[3].size(), 10u) << "the last view has nothing left: the test shows nothing";
  for (unsigned on_second = 0; on_second < 16; ++on_second) {  // a bit per view
    const std::unique_ptr<FusionStamps> stamps = (on_second & 1 ? first_ : second_)->MakeFusionStamps();
    std::vector<PointCloud> clouds;
    for (int i = 0; i < 4; ++i) {
      const bool second = (on_second >> i & 1) != 0;
      clouds.push_back(FuseOne((second ? second_ : first_).get(), second ? others : views, NoisyNeighbors(), i,
                               stamps.get(), options));
    }
    EXPECT_EQ(FirstDifference(clouds, expected), "") << "on the second: " << on_second;
  }
}

TEST_P(SeveralGpusTest, EnginesWorkOnAfterStampsHaveMoved) {
  // The GPU that is selected for the thread must be the engine's again, also for what is allocated later.
  const std::vector<EngineView> views = UploadViews(NoisyViews(), first_.get()), others = Imported(views);
  const std::unique_ptr<FusionStamps> stamps = first_->MakeFusionStamps();
  FuseOne(first_.get(), views, NoisyNeighbors(), 0, stamps.get());
  FuseOne(second_.get(), others, NoisyNeighbors(), 1, stamps.get());
  const std::vector<PointCloud> expected = FuseAll(first_.get(), views, NoisyNeighbors());
  EXPECT_EQ(FirstDifference(FuseAll(second_.get(), others, NoisyNeighbors()), expected), "");
  EXPECT_EQ(FirstDifference(FuseAll(first_.get(), views, NoisyNeighbors()), expected), "");
}

}  // namespace
}  // namespace acmp
