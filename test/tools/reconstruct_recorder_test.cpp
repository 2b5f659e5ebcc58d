#include "reconstruct_recorder.h"

#include <gtest/gtest.h>

#include <functional>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/host_depth_engine.h"
#include "dataset/test_folder.h"
#include "support/pass_result.h"
#include "support/planar_scene.h"
#include "tools/reconstruct_fake_matcher.h"

namespace acmp {
namespace {

/// A device that is lost.
class LostEngine final : public DepthEngine {
 public:
  std::unique_ptr<DepthEngine> Share() override { Fail(); }
  EngineImagePtr Load(const FramePtr&, int) override { Fail(); }
  EngineEstimatePtr RunPhotometric(const EngineProblem&, const PatchMatchOptions&, int) override { Fail(); }
  EngineEstimatePtr Upsample(const EngineEstimatePtr&, const FramePtr&, int) override { Fail(); }
  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr&, const DepthRange&,
                                              const PlanarPriorOptions&) override {
    Fail();
  }
  EngineEstimatePtr RunPlanarPrior(const EngineProblem&, const PatchMatchOptions&, EngineEstimatePtr,
                                   const PriorMesh&) override {
    Fail();
  }
  EngineEstimatePtr RunGeometric(const EngineProblem&, const PatchMatchOptions&, EngineEstimatePtr, int) override {
    Fail();
  }
  EngineEstimatePtr RestoreDetails(const EngineProblem&, const PatchMatchOptions&, EngineEstimatePtr,
                                   const EngineEstimatePtr&) override {
    Fail();
  }
  EngineEstimatePtr Complete(const EngineProblem&, const CompletionOptions&) override { Fail(); }
  EngineEstimatePtr RefuteUnsupported(const EngineProblem&, EngineEstimatePtr) override { Fail(); }
  ConsistencyResult FilterByConsistency(const EngineView&, const std::vector<EngineView>&,
                                        const FusionOptions&) override {
    Fail();
  }
  EstimateMaps Download(const EngineEstimatePtr&) override { Fail(); }
  EstimateState DownloadState(const EngineEstimatePtr&) override { Fail(); }
  std::unique_ptr<FusionStamps> MakeFusionStamps() override { Fail(); }
  PointCloud FuseView(const EngineView&, const std::vector<EngineView>&, const FusionOptions&, int,
                      FusionStamps*) override {
    Fail();
  }
  EngineEstimatePtr UploadMaps(const EstimateMapViews&, const PinholeCamera&) override { Fail(); }
  EngineEstimatePtr UploadState(EstimateState, const PinholeCamera&) override { Fail(); }
  double TakeDeviceMs() override { return 0; }
  size_t DeviceBytes() const override { return 0; }
  size_t FreeDeviceBytes() const override { return 0; }
  std::string device_name() const override { return "lost"; }

 private:
  [[noreturn]] static void Fail() { throw ProcessingError("device lost"); }
};

FramePtr SmallFrame(int id) {
  Frame frame;
  frame.id = id;
  frame.camera = TestCamera(15, 11);
  frame.cam_from_world = LookAhead({0.2 * id, 0, 0}, 0, 0, 0);
  frame.gray = GrayImage(15, 11, 100.0f + static_cast<float>(id));
  return std::make_shared<const Frame>(std::move(frame));
}

class RecordingDepthEngineTest : public TestFolder {
 protected:
  EngineProblem Problem(DepthEngine* engine) const {
    return {{reference_, engine->Load(reference_, 1), nullptr}, {{source_, engine->Load(source_, 1), nullptr}}, {1, 9}};
  }
  std::filesystem::path Recorded(int pass) const { return out_.WorkFile(RecordingDepthEngine::kStage, pass); }

  /// One estimate with every kind of pass, starting on halved images.
  EstimateState RunAll(RecordingDepthEngine* recorder) const {
    const EngineProblem problem = Problem(recorder);
    const EngineEstimatePtr halved = recorder->RunPhotometric(problem, {}, 1);
    EXPECT_EQ(recorder->DownloadState(halved).planes.width(), 7);
    const EngineEstimatePtr start = recorder->Upsample(halved, reference_, 1);
    const EngineEstimatePtr initial = recorder->RunPlanarPrior(problem, {}, start, {});
    return recorder->DownloadState(recorder->RunGeometric(problem, {}, initial, 0));
  }

  const FramePtr reference_ = SmallFrame(0), source_ = SmallFrame(1);
  const ReconstructFolder out_{folder() / "out", {}, false};
  const InterruptWatcher watcher_;
  FakePatchMatch fake_;
  HostDepthEngine engine_{&fake_};
};

TEST_F(RecordingDepthEngineTest, ReadsWhatAnEarlierRunHasRecorded) {
  RecordingDepthEngine first(&engine_, &out_, &watcher_);
  const EstimateState recorded = RunAll(&first);
  EXPECT_EQ(first.passes_run(), 3);
  EXPECT_EQ(first.TakeDeviceMs(), 3);
  RecordingDepthEngine second(&engine_, &out_, &watcher_);
  EXPECT_TRUE(SameBits(RunAll(&second), recorded));
  EXPECT_EQ(second.passes_run(), 0);
  EXPECT_EQ(second.TakeDeviceMs(), 0);
  EXPECT_EQ(fake_.calls.size(), 3u);
}

TEST_F(RecordingDepthEngineTest, RunsAgainWhatIsMissingOrDamaged) {
  RecordingDepthEngine first(&engine_, &out_, &watcher_);
  const EstimateState recorded = RunAll(&first);
  std::filesystem::remove(Recorded(2));
  std::filesystem::resize_file(Recorded(1), std::filesystem::file_size(Recorded(1)) - 1);
  RecordingDepthEngine second(&engine_, &out_, &watcher_);
  EXPECT_TRUE(SameBits(RunAll(&second), recorded));
  EXPECT_EQ(second.passes_run(), 2);
}

TEST_F(RecordingDepthEngineTest, ResultOfAnotherSizeAbortsTheRun) {
  RecordingDepthEngine first(&engine_, &out_, &watcher_);
  RunAll(&first);
  RecordingDepthEngine second(&engine_, &out_, &watcher_);
  EXPECT_THROW(second.RunPhotometric(Problem(&second), {}, 0), RunAborted);  // was of the halved images
}

TEST_F(RecordingDepthEngineTest, NothingIsRecordedAfterAnInterruption) {
  InterruptWatcher interrupted;
  fake_.on_call = [&](int) { interrupted.Request(); };
  RecordingDepthEngine recorder(&engine_, &out_, &interrupted);
  EXPECT_THROW(recorder.RunPhotometric(Problem(&recorder), {}, 0), Interrupted);
  EXPECT_FALSE(std::filesystem::exists(Recorded(0)));
  EXPECT_THROW(recorder.RunPhotometric(Problem(&recorder), {}, 0), Interrupted);
  EXPECT_EQ(fake_.calls.size(), 1u) << "no pass begins after an interruption";
}

TEST_F(RecordingDepthEngineTest, BadInputIsTheKeyframesOwnFault) {
  RecordingDepthEngine recorder(&engine_, &out_, &watcher_);
  EXPECT_THROW(recorder.Load(reference_, -1), InvalidInputError);
  EXPECT_THROW(recorder.RunPhotometric({}, {}, 0), InvalidInputError);
  EngineProblem alone = Problem(&recorder);
  alone.sources.clear();
  EXPECT_THROW(recorder.RunPhotometric(alone, {}, 0), InvalidInputError);
}

TEST_F(RecordingDepthEngineTest, FailureOfAnyStepAbortsTheRun) {
  // Else the mapper would go on with the next keyframe, and its passes would be recorded under other numbers than in a
  // run without the failure.
  LostEngine lost;
  RecordingDepthEngine recorder(&lost, &out_, &watcher_);
  const EngineProblem problem = Problem(&engine_);
  const std::vector<std::function<void()>> steps = {
      [&] { recorder.Load(reference_, 0); },
      [&] { recorder.RunPhotometric(problem, {}, 0); },
      [&] { recorder.Upsample(nullptr, reference_, 0); },
      [&] {
        recorder.FindSupportPoints(nullptr, {1, 9}, {});
      },
      [&] { recorder.RunPlanarPrior(problem, {}, nullptr, {}); },
      [&] { recorder.RunGeometric(problem, {}, nullptr, 0); },
      [&] { recorder.Complete(problem, {}); },
      [&] { recorder.RefuteUnsupported(problem, nullptr); },
      [&] { recorder.FilterByConsistency({}, {}, {}); },
      [&] { recorder.Download(nullptr); },
      [&] { recorder.DownloadState(nullptr); },
      [&] { recorder.UploadState({}, {}); },
  };
  for (size_t i = 0; i < steps.size(); ++i) {
    try {
      steps[i]();
      ADD_FAILURE() << "step " << i << " did not fail";
    } catch (const RunAborted& aborted) {
      EXPECT_THROW(std::rethrow_exception(aborted.reason), ProcessingError);
    }
  }
}

TEST_F(RecordingDepthEngineTest, CannotBeShared) {
  RecordingDepthEngine recorder(&engine_, &out_, &watcher_);
  EXPECT_THROW(recorder.Share(), InvalidInputError);
  EXPECT_EQ(recorder.device_name(), "fake (for tests)");
}

}  // namespace
}  // namespace acmp
