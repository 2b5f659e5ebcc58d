#include "reconstruct_recorder.h"

#include <utility>

#include "acmp_mapping/common/error.h"
#include "reconstruct_work_files.h"

namespace acmp {
namespace {

template <class Step>
auto Guarded(const Step& step) {
  try {
    return step();
  } catch (const InvalidInputError&) {
    throw;  // the keyframe's own fault, and the same in every run
  } catch (const std::exception&) {
    throw RunAborted{std::current_exception()};
  }
}

}  // namespace

RecordingDepthEngine::RecordingDepthEngine(DepthEngine* engine, const ReconstructFolder* folder,
                                           const InterruptWatcher* interrupt)
    : engine_(engine), folder_(folder), interrupt_(interrupt) {
  folder_->MakeWorkFolder(kStage);
}

template <class Pass>
EngineEstimatePtr RecordingDepthEngine::Recorded(const EngineProblem& problem, int level, const Pass& pass) {
  CheckHandles(problem, level);
  interrupt_->Check();
  const PinholeCamera camera = CameraAtLevel(problem.reference.frame->camera, level);
  const auto path = folder_->WorkFile(kStage, next_pass_++);
  return Guarded([&] {
    if (IsWholeWorkFile(path)) return engine_->UploadState(ReadEstimate(path, camera.width, camera.height), camera);
    ++passes_run_;
    EngineEstimatePtr estimate = pass();
    const EstimateState state = engine_->DownloadState(estimate);
    interrupt_->Check();
    WriteEstimate(path, state);
    return estimate;
  });
}

std::unique_ptr<DepthEngine> RecordingDepthEngine::Share() {
  throw InvalidInputError("the engine of a recorded run cannot be shared");
}

EngineImagePtr RecordingDepthEngine::Load(const FramePtr& frame, int levels) {
  return Guarded([&] { return engine_->Load(frame, levels); });
}

EngineEstimatePtr RecordingDepthEngine::RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                                       int level) {
  return Recorded(problem, level, [&] { return engine_->RunPhotometric(problem, options, level); });
}

EngineEstimatePtr RecordingDepthEngine::Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) {
  return Guarded([&] { return engine_->Upsample(estimate, frame, level); });
}

std::vector<SupportPoint> RecordingDepthEngine::FindSupportPoints(const EngineEstimatePtr& estimate,
                                                                  const DepthRange& range,
                                                                  const PlanarPriorOptions& options) {
  return Guarded([&] { return engine_->FindSupportPoints(estimate, range, options); });
}

EngineEstimatePtr RecordingDepthEngine::RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                                       EngineEstimatePtr start, const PriorMesh& prior) {
  return Recorded(problem, 0, [&] { return engine_->RunPlanarPrior(problem, options, std::move(start), prior); });
}

EngineEstimatePtr RecordingDepthEngine::RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                                     EngineEstimatePtr start, int pass) {
  return Recorded(problem, 0, [&] { return engine_->RunGeometric(problem, options, std::move(start), pass); });
}

EngineEstimatePtr RecordingDepthEngine::RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                                       EngineEstimatePtr start, const EngineEstimatePtr& coarser) {
  return Recorded(problem, 0, [&] { return engine_->RestoreDetails(problem, options, std::move(start), coarser); });
}

EngineEstimatePtr RecordingDepthEngine::Complete(const EngineProblem& problem, const CompletionOptions& options) {
  return Recorded(problem, 0, [&] { return engine_->Complete(problem, options); });
}

EngineEstimatePtr RecordingDepthEngine::RefuteUnsupported(const EngineProblem& problem, EngineEstimatePtr start) {
  return Guarded([&] { return engine_->RefuteUnsupported(problem, std::move(start)); });  // as fast as reading a file
}

ConsistencyResult RecordingDepthEngine::FilterByConsistency(const EngineView& reference,
                                                            const std::vector<EngineView>& sources,
                                                            const FusionOptions& options) {
  return Guarded([&] { return engine_->FilterByConsistency(reference, sources, options); });
}

std::unique_ptr<FusionStamps> RecordingDepthEngine::MakeFusionStamps() { return engine_->MakeFusionStamps(); }

PointCloud RecordingDepthEngine::FuseView(const EngineView& reference, const std::vector<EngineView>& sources,
                                          const FusionOptions& options, int rank, FusionStamps* stamps) {
  return Guarded([&] { return engine_->FuseView(reference, sources, options, rank, stamps); });
}

DepthMap RecordingDepthEngine::DownloadDepth(const EngineEstimatePtr& estimate) {
  return Guarded([&] { return engine_->DownloadDepth(estimate); });
}

EstimateMaps RecordingDepthEngine::Download(const EngineEstimatePtr& estimate) {
  return Guarded([&] { return engine_->Download(estimate); });
}

EstimateState RecordingDepthEngine::DownloadState(const EngineEstimatePtr& estimate) {
  return Guarded([&] { return engine_->DownloadState(estimate); });
}

EngineEstimatePtr RecordingDepthEngine::UploadState(EstimateState state, const PinholeCamera& camera) {
  return Guarded([&] { return engine_->UploadState(std::move(state), camera); });
}

EngineEstimatePtr RecordingDepthEngine::UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) {
  return Guarded([&] { return engine_->UploadMaps(maps, camera); });
}

}  // namespace acmp
